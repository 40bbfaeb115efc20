"""Draw the state diagram of a rig and the sequence diagrams of its calls for docs/contract.md.

`python scripts/site/contract_pictures.py [--out docs/pictures]`. Add new states and messages to the tables.
"""

from __future__ import annotations

import argparse
import textwrap
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

ROOT = Path(__file__).resolve().parents[2]

STATES: Final = {
    # Name in the drawing: its mode, whether `run` is named in it, centre of its box, and what it means.
    "idle": ("RIG_MODE_IDLE", False, (150, 80), "at rest, may play"),
    "settling": ("RIG_MODE_SETTLING", True, (470, 80), "on its way to the first sample"),
    "playing": ("RIG_MODE_PLAYING", True, (790, 80), "plays and publishes blocks"),
    "ramping down": ("RIG_MODE_RAMPING_DOWN", True, (1110, 80), "all is played, on its way to zero"),
    "waiting": ("RIG_MODE_WAITING", True, (470, 330), "waits for a controller or a person"),
    "latched, at rest": ("RIG_MODE_INTERLOCKED", False, (150, 580), "refuses to play"),
    "latched, moving": ("RIG_MODE_INTERLOCKED", True, (790, 580), "on its way down, or to the end of the run"),
}

TRANSITIONS: Final = {
    ("idle", "settling"): "play",
    ("settling", "playing"): "first sample",
    ("playing", "ramping down"): "drive over",
    ("ramping down", "idle"): "at zero",
    ("playing", "idle"): "drive over, and at zero",
    ("settling", "waiting"): "drive is handed over",
    ("waiting", "playing"): "response\nis there",
    ("waiting", "idle"): "refused, commander gone",
    ("waiting", "latched, moving"): "stop",
    ("settling", "latched, moving"): "stop, watchdog,\ncommander gone",
    ("playing", "latched, moving"): "stop, watchdog, fault,\ncommander gone",
    ("ramping down", "latched, moving"): "stop, watchdog, fault",
    ("latched, moving", "latched, at rest"): "at rest; play is answered",
    ("idle", "latched, at rest"): "stop",
    ("latched, at rest", "idle"): "reset",
}


class Step(NamedTuple):
    """Message of a sequence; if sender and receiver are equal, an action of that participant."""

    sender: str
    receiver: str
    text: str
    answer: bool = False


_ALL = "all others"
SEQUENCES: Final = {
    "call_read": (
        ("client", "rig"),
        (
            Step("client", "rig", "description, frf or state"),
            Step("rig", "client", "RigDescription, RigFrf or RigState; or a Fault", answer=True),
        ),
    ),
    "call_play": (
        ("commander", "rig", _ALL),
        (
            Step("commander", "rig", "liveliness token asking/<id>"),
            Step("commander", "rig", "play: PlayRequest with <id> as attachment"),
            Step("rig", "rig", "checks everything; a refusal is a Fault, and nothing moves"),
            Step("rig", _ALL, "RigState: SETTLING, run"),
            Step("rig", "commander", "Progress, at least every second until the answer", answer=True),
            Step("rig", "rig", "goes to the first sample"),
            Step("rig", _ALL, "RigState: PLAYING, run"),
            Step("rig", _ALL, "SignalBlock, again and again; the last one has `last`"),
            Step("rig", _ALL, "RigState: RAMPING_DOWN, run"),
            Step("rig", "rig", "returns to zero"),
            Step("rig", _ALL, "RigState: IDLE"),
            Step("rig", "commander", "PlayResult: response, epoch, number of blocks", answer=True),
        ),
    ),
    "call_stop": (
        ("commander", "rig", _ALL),
        (
            Step(_ALL, "rig", "stop: StopRequest with a reason, while a run plays"),
            Step("rig", _ALL, "RigState: INTERLOCKED, run, reason"),
            Step("rig", "rig", "ramps down at once"),
            Step("rig", _ALL, "SignalBlock of what is played meanwhile"),
            Step("rig", _ALL, "RigState: INTERLOCKED, reason"),
            Step("rig", "commander", "play ends: Fault CANCELLED", answer=True),
            Step("rig", _ALL, "stop ends: RigState, at rest", answer=True),
        ),
    ),
    "call_commander_gone": (
        ("commander", "rig", _ALL),
        (
            Step("commander", "commander", "its process dies, or it gives up its query"),
            Step("commander", "rig", "token asking/<id> goes"),
            Step("rig", _ALL, "RigState: INTERLOCKED, run, reason"),
            Step("rig", "rig", "ramps down; a run that cannot be stopped goes on to its end"),
            Step("rig", _ALL, "RigState: INTERLOCKED, reason"),
        ),
    ),
    "call_reset": (
        ("operator", "rig", _ALL),
        (
            Step("operator", "rig", "reset: ResetRequest with an id, `command`"),
            Step("rig", "rig", "an id that was done before: ALREADY_EXISTS"),
            Step("rig", "rig", "waits for rest; in vain: DEADLINE_EXCEEDED"),
            Step("rig", "rig", "another stop meanwhile: FAILED_PRECONDITION"),
            Step("rig", _ALL, "RigState: IDLE"),
            Step("rig", "operator", "RigState", answer=True),
        ),
    ),
}

_STYLE = """<style>
text { font-family: "Inter", "Segoe UI", "Helvetica Neue", Arial, sans-serif; fill: #263238; }
text { font-size: 14px; text-anchor: middle; }
.title { font-size: 18px; font-weight: 600; }
.line { fill: #455a64; }
.arrow { fill: none; stroke: #37474f; stroke-width: 2; }
.answer { stroke-dasharray: 6 5; }
.life { stroke: #90a4ae; stroke-width: 1.5; }
</style>
<defs><marker id="head" viewBox="0 0 10 10" refX="8" refY="5" markerWidth="7" markerHeight="7" orient="auto">
<path d="M 0 0 L 10 5 L 0 10 z" fill="#37474f"/></marker></defs>"""
_BOX = (240, 76)
_COLUMN, _ROW, _TOP = 440, 44, 100


def _svg(width: int, height: int, label: str, parts: list[str]) -> str:
    size = f'viewBox="0 0 {width} {height}" role="img" aria-label="{escape(label)}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
    return "\n".join([head, _STYLE, f'<rect width="{width}" height="{height}" fill="#ffffff"/>', *parts, "</svg>\n"])


def _text(x: float, y: float, text: str, kind: str = "line") -> list[str]:
    lines = text.split("\n")
    return [
        f'<text x="{x:g}" y="{y + 18 * row:g}" class="{kind}">{escape(line)}</text>' for row, line in enumerate(lines)
    ]


def _arrow(path: str, *, answer: bool = False) -> str:
    return f'<path d="{path}" class="arrow{" answer" if answer else ""}" marker-end="url(#head)"/>'


def _box(x: float, y: float, title: str, line: str, *, red: bool) -> list[str]:
    width, height = _BOX
    fill, stroke = ("#ffebee", "#b71c1c") if red else ("#e3f2fd", "#1565c0")
    rest = f'width="{width}" height="{height}" rx="10" fill="{fill}" stroke="{stroke}" stroke-width="1.6"'
    lines = "\n".join(textwrap.wrap(line, 32))
    return [
        f'<rect x="{x - width / 2:g}" y="{y - height / 2:g}" {rest}/>',
        *_text(x, y - (8 if "\n" not in lines else 14), title, "title"),
        *_text(x, y + (16 if "\n" not in lines else 8), lines),
    ]


# Paths of arrows and positions of their labels, for arrows that are not straight between two neighbours.
_WAYS: Final = {
    ("playing", "idle"): ("M 760 42 C 700 -10, 250 -10, 180 40", (470, 20)),
    ("ramping down", "idle"): ("M 1110 118 C 1090 215, 300 215, 210 120", (330, 206)),
    ("settling", "waiting"): ("M 440 118 L 440 290", (356, 270)),
    ("waiting", "playing"): ("M 590 320 C 680 300, 720 200, 740 120", (632, 346)),
    ("waiting", "idle"): ("M 352 320 C 280 300, 240 240, 220 120", (262, 346)),
    ("waiting", "latched, moving"): ("M 500 368 C 540 470, 620 520, 690 540", (504, 460)),
    ("settling", "latched, moving"): ("M 550 118 C 640 240, 700 420, 740 540", (534, 236)),
    ("playing", "latched, moving"): ("M 790 118 L 790 540", (878, 412)),
    ("ramping down", "latched, moving"): ("M 1140 118 C 1110 380, 960 510, 890 540", (1080, 470)),
    ("latched, moving", "latched, at rest"): ("M 668 580 L 274 580", (470, 602)),
    ("idle", "latched, at rest"): ("M 110 118 L 110 540", (84, 400)),
    ("latched, at rest", "idle"): ("M 160 542 L 160 120", (192, 470)),
}


def state_diagram() -> str:
    """Return the state diagram as SVG."""
    parts: list[str] = []
    for pair, label in TRANSITIONS.items():
        (start, y), (end, _) = (STATES[name][2] for name in pair)
        half = _BOX[0] / 2
        path, place = _WAYS.get(pair, (f"M {start + half:g} {y} L {end - half - 2:g} {y}", ((start + end) / 2, y - 12)))
        parts += [_arrow(path), *_text(*place, label)]
    for name, (_, _, (x, y), meaning) in STATES.items():
        parts += _box(x, y, name, meaning, red=name.startswith("latched"))
    return _svg(1260, 640, "States of a rig and what takes it from one to another", parts)


def sequence_diagram(name: str) -> str:
    """Return one of the sequence diagrams as SVG."""
    who, steps = SEQUENCES[name]
    places = {one: 130 + _COLUMN * column for column, one in enumerate(who)}
    height = _TOP + _ROW * len(steps) + 20
    parts: list[str] = []
    for one, x in places.items():
        parts.append(f'<path d="M {x} 60 L {x} {height - 14}" class="life"/>')
        parts += [f'<rect x="{x - 90}" y="20" width="180" height="40" rx="8" fill="#e3f2fd" stroke="#1565c0"/>']
        parts += _text(x, 46, one, "title")
    for row, step in enumerate(steps):
        y, start, end = _TOP + _ROW * row, places[step.sender], places[step.receiver]
        if start == end:
            parts.append(
                f'<rect x="{start - 210}" y="{y - 16}" width="420" height="30" rx="6" fill="#fff8e1" stroke="#b26a00"/>'
            )
            parts += _text(start, y + 4, step.text)
            continue
        # The label is beside the crossed lifeline, which is not the receiver.
        parts += [_arrow(f"M {start} {y + 6} L {end + (-3 if end > start else 3)} {y + 6}", answer=step.answer)]
        near = end if abs(end - start) == _COLUMN else start + (_COLUMN if end > start else -_COLUMN)
        parts += _text((start + near) / 2, y - 2, step.text)
    return _svg(
        260 + _COLUMN * (len(who) - 1) + (160 if len(who) == 2 else 0), height, f"Sequence of {name[5:]}", parts
    )


def pictures() -> dict[str, str]:
    """Return every picture by its file's name."""
    return {"rig_states.svg": state_diagram()} | {f"{name}.svg": sequence_diagram(name) for name in SEQUENCES}


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    folder: Path = parser.parse_args().out
    for name, content in pictures().items():
        (folder / name).write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main()
