"""Measure every shipped rig (speed, error, start-up, memory), identification and iteration.

Writes out/bench.json and a table.

`python benchmarks/bench.py [--rig NAME …] [--out FILE]`
"""

import argparse
import json
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from bus import measure_bus
from drives import noise_drive, playable_share
from identification import measure_identification
from iteration import measure_iteration
from live_view import measure_live_view
from machine import machine
from processes import memory, startup_seconds
from recording import measure_recorder
from speed import drake_real_time_factor, real_time_factor, real_time_factor_of_two, relative_error

from rig_sim import shipped_specimens
from rig_sim.loading import load_any_rig
from rig_sim.player import Rig

SECONDS = 60.0
ERROR_SECONDS = 10.0
DRAKE_SECONDS = 0.3


@dataclass(frozen=True)
class Figures:
    """What was measured of one rig; None where it does not apply.

    Real-time factors are simulated seconds per wall second, `rtf_two` the sum of two rigs on two threads; `error` is
    the worst response's, relative; start-up in s, without and with a cache of bytecode; memory of a process that plays
    120 s in MiB, its growth beyond the record itself.
    """

    rig: str
    lanes: int | None
    operations: int | None
    integrator: str | None
    substeps: int | None
    drive_share: float
    rtf: float
    error: float | None
    rtf_two: float
    drake_rtf: float | None
    startup_cold: float
    startup_warm: float
    memory_peak: float
    memory_growth: float


def measure(path: Path) -> Figures:
    """Measure one rig."""
    rig = load_any_rig(path)
    share = playable_share(rig)
    drive = noise_drive(rig, seconds=SECONDS, share=share)
    integrated = isinstance(rig, Rig)
    cold, warm = startup_seconds(path)
    taken = memory(path, share=share)
    return Figures(
        rig=rig.specimen.name,
        lanes=rig.compiled.lanes if integrated else None,
        operations=rig.compiled.operation_count if integrated else None,
        integrator=rig.specimen.integrator.value if integrated else None,
        substeps=rig.specimen.substeps if integrated else None,
        drive_share=share,
        rtf=real_time_factor(rig, drive),
        error=relative_error(rig, noise_drive(rig, seconds=ERROR_SECONDS, share=share)),
        rtf_two=real_time_factor_of_two(rig, drive),
        drake_rtf=(
            drake_real_time_factor(path, noise_drive(rig, seconds=DRAKE_SECONDS, share=share)) if integrated else None
        ),
        startup_cold=cold,
        startup_warm=warm,
        memory_peak=taken.peak,
        memory_growth=taken.growth,
    )


def table(figures: list[Figures]) -> str:
    """Return the figures as text, one figure a line, one rig a column."""
    lines = [asdict(row) for row in figures]
    rows = [[name, *(_cell(line[name]) for line in lines)] for name in Figures.__dataclass_fields__]
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    )


def _cell(value: object) -> str:
    return "–" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


def main() -> None:
    """Measure the chosen rigs, all by default."""
    shipped = shipped_specimens()
    parser = argparse.ArgumentParser(description="Measure speed, error, start-up and memory of the shipped rigs.")
    parser.add_argument(
        "--rig", action="append", choices=sorted(shipped), help="only this one, and no identification; may be repeated"
    )
    parser.add_argument("--out", type=Path, default=Path("out/bench.json"))
    arguments = parser.parse_args()
    figures = []
    for name in arguments.rig or shipped:
        figures.append(measure(shipped[name]))
        sys.stderr.write(f"{name}: {figures[-1].rtf:.0f} times real time\n")
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    document: dict[str, object] = {
        "seconds": SECONDS,
        "machine": machine(),
        "rigs": {row.rig: {name: value for name, value in asdict(row).items() if name != "rig"} for row in figures},
    }
    if not arguments.rig:
        document["identification"] = measure_identification(arguments.out.parent / "peers")
        document["iteration"] = measure_iteration()
        document["live_view"] = measure_live_view()
        document["bus"] = measure_bus()
        with tempfile.TemporaryDirectory(dir=arguments.out.parent) as folder:
            document["recorder"] = measure_recorder(Path(folder))
    arguments.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    sys.stdout.write(f"{', '.join(f'{name}: {value}' for name, value in machine().items())}\n{table(figures)}\n")
    for part in ("identification", "iteration", "bus", "recorder"):
        if part in document:
            sys.stdout.write(f"{part}\n{json.dumps(document[part], indent=2)}\n")


if __name__ == "__main__":
    main()
