"""The fenced blocks of a page, and how each kind of them is run as written, in order, in one empty folder.

What a reviewer sees behind the language of a fence says what a test does with it:

- `console`: every line that begins with `$ ` is run, the others show what it prints. `exit=3`: its last command ends
  with that code. `background`: its command goes on running until the end of the page; the next block waits until it has
  said what the page shows of it, up to `…`, or else until it listens. `make` is run dry, in the repository: it would
  set up and test what is being tested.
- `python`: run as a script. `yaml`: a part of a campaign file that has to fit into one; `part-of=rig_sim`, of that
  service's configuration; `part-of=sweep`, a whole sweep file; `part-of=project`, a project.
- `file=NAME`: written under that name, and run where a later command says so.
- `not-run="why"`: not run, for a reason that the site shows too.
- `text`, `json` and the like show something; a fence without a language is refused.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml

import duralab
from duralab.campaign import parse_project
from duralab.sweeps import load_sweep
from rig_sim.service import RigSimConfig

ROOT = Path(__file__).resolve().parents[1]
PORT = "tcp/127.0.0.1:7474"
SECONDS = 300
OWN_TESTS = {
    "docs/security.md": "tests/security/test_security_guide.py",
    "docs/guides/offline_analysis.md": "tests/long/test_offline_guide.py",
    "docs/guides/fmu-rig.md": "tests/long/test_fmu_campaign.py",
    "docs/guides/own-specimen.md": "services/rig_sim/tests/long/test_own_specimen.py",
}
"""Pages whose blocks another test runs, and compares with what the page shows."""

SHOWN = {"text", "json", "html", "xml", "css", "protobuf", "toml"}
"""Languages of blocks that show something."""

_FENCE = re.compile(r"^(?P<fence>`{3,})(?P<told>[^`\n]*)\n(?P<text>.*?)^(?P=fence)$", flags=re.M | re.S)
_OPTION = re.compile(r'([\w-]+)(?:=(?:"([^"]*)"|(\S+)))?')


@dataclass(frozen=True)
class Fence:
    """One fenced block of a page."""

    page: str
    line: int
    language: str
    text: str
    options: dict[str, str] = field(default_factory=dict)

    @property
    def commands(self) -> list[str]:
        """The commands of a console block, those over several lines put together."""
        joined = self.text.replace("\\\n", " ")
        return [line.removeprefix("$ ") for line in joined.splitlines() if line.startswith("$ ")]

    @property
    def shown(self) -> str:
        """What the first command of a console block prints first, up to an ellipsis; empty where none is shown."""
        lines = [line for line in self.text.splitlines() if not line.startswith("$ ")]
        return lines[0].partition("…")[0].strip() if lines else ""

    def __str__(self) -> str:
        """Return where it stands."""
        return f"{self.page}:{self.line}"


def pages() -> list[str]:
    """Return every page of the documentation and every README, by its path in the repository."""
    readmes = [path for depth in ("*", "*/*", "*/*/*") for path in ROOT.glob(f"{depth}.md") if path.name == "README.md"]
    found = {*readmes, *ROOT.joinpath("docs").rglob("*.md")}
    names = {path.relative_to(ROOT).as_posix() for path in found}
    return sorted(name for name in names if not name.startswith((".", "out/")))


def fences(page: str) -> list[Fence]:
    """Return the fenced blocks of a page."""
    content = (ROOT / page).read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(content):
        language, _, rest = match["told"].partition(" ")
        options = {name: quoted or plain or "" for name, quoted, plain in _OPTION.findall(rest)}
        line = content.count("\n", 0, match.start()) + 1
        found.append(Fence(page=page, line=line, language=language, text=match["text"], options=options))
    return found


def is_run(fence: Fence) -> bool:
    """Whether a block does something, alone or with the command that comes after it."""
    return "not-run" not in fence.options and fence.language not in SHOWN


def pages_that_run(*folders: str) -> list[str]:
    """Return the pages in folders of the repository whose blocks are run here; "" is all that is not in `docs`."""
    return [
        page
        for page in pages()
        if page not in OWN_TESTS
        and (page.startswith(tuple(folder for folder in folders if folder)) or ("" in folders and "docs/" not in page))
        and any(is_run(block) for block in fences(page))
    ]


def run_page(page: str, request: pytest.FixtureRequest, folder: Path) -> dict[str, float]:
    """Run all blocks of a page in a folder, beside the module's lab where the page takes one for granted.

    Returns the seconds that each command took.
    """
    blocks = fences(page)
    endpoint = request.getfixturevalue("lab").endpoints[0] if needs_a_lab(blocks) else free_endpoint()
    with page_run(folder, endpoint=endpoint) as run:
        for block in blocks:
            if is_run(block):
                run.run(block)
    return run.seconds


def free_endpoint() -> str:
    """Return an endpoint on which nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def needs_a_lab(blocks: list[Fence]) -> bool:
    """Whether a page takes it that a lab runs already on the default port, without starting it."""
    if any("background" in block.options for block in blocks):
        return False
    return any(PORT in block.text or "duralab.connect()" in block.text for block in blocks if is_run(block))


class PageRun:
    """Runs the blocks of a page in a folder; the default port of the page is another one here.

    Parameters
    ----------
    folder : Path
        Empty.
    endpoint : str
        Where the page's lab listens, or shall listen.
    """

    def __init__(self, folder: Path, *, endpoint: str) -> None:
        self._folder = folder
        self._endpoint = endpoint
        self._background: list[subprocess.Popen[bytes]] = []
        self.seconds: dict[str, float] = {}
        binaries = Path(sys.executable).parent
        self._environment = {
            **os.environ,
            "PATH": f"{binaries}{os.pathsep}{os.environ['PATH']}",
            "PYTHONWARNINGS": "error",
            "NO_COLOR": "1",
            "COLUMNS": "120",
            # A lab that a page starts is told apart from one that somebody runs on this machine.
            "XDG_RUNTIME_DIR": str(folder),
            "XDG_STATE_HOME": str(folder),
        }

    def run(self, block: Fence) -> None:
        """Run one block as its fence says."""
        text = self._local(block.text)
        if name := block.options.get("file"):
            path = self._folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        elif block.language == "python":
            # A script of its own, so that a traceback shows the line.
            path = self._folder / f"block_{block.line}.py"
            path.write_text(text, encoding="utf-8")
            self._finish(block, f"python {path.name}", expected=0)
        elif block.language == "yaml" and block.options.get("part-of") == "rig_sim":
            RigSimConfig.model_validate(yaml.safe_load(text))
        elif block.language == "yaml" and block.options.get("part-of") == "sweep":
            path = self._folder / f"block_{block.line}.yaml"
            path.write_text(text, encoding="utf-8")
            load_sweep(path)
        elif block.language == "yaml" and block.options.get("part-of") == "project":
            parse_project(text, name=str(block))
        elif block.language == "yaml":
            fit_into_a_campaign(text, self._folder / f"block_{block.line}.yaml")
        elif block.language == "console":
            self._console(block)
        else:
            raise AssertionError(f"{block}: nothing is known to do with a block of {block.language!r}.")

    def _console(self, block: Fence) -> None:
        *before, last = block.commands
        for command in before:
            self._finish(block, command, expected=0)
        if "background" in block.options:
            self._go_on(block, last)
        else:
            self._finish(block, last, expected=int(block.options.get("exit", 0)))

    def _finish(self, block: Fence, command: str, *, expected: int) -> None:
        dry, began = command.startswith("make "), time.monotonic()
        done = subprocess.run(
            ["bash", "-c", f"make --dry-run {command.removeprefix('make ')}" if dry else self._local(command)],
            cwd=ROOT if dry else self._folder,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
        self.seconds[command] = self.seconds.get(command, 0.0) + time.monotonic() - began
        told = f"{block}: `{command}` ended with {done.returncode}, not {expected}.\n{done.stdout}\n{done.stderr}"
        assert done.returncode == expected, told

    def _go_on(self, block: Fence, command: str) -> None:
        log = self._folder / f"background_{block.line}.txt"
        with log.open("wb") as out:
            process = subprocess.Popen(
                ["bash", "-c", f"exec {self._local(command)}"],
                cwd=self._folder,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
            )
        self._background.append(process)
        # Ended by a later command it is not to linger, as it would not in a terminal.
        threading.Thread(target=process.wait, daemon=True).start()
        port = int(self._endpoint.rpartition(":")[2])
        while process.poll() is None:
            if block.shown:
                if block.shown in log.read_text(encoding="utf-8"):
                    return
            else:
                with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
                    return
            time.sleep(0.1)
        raise AssertionError(f"{block}: `{command}` ended with {process.returncode}.\n{log.read_text()}")

    def end(self) -> None:
        """End what goes on running as Ctrl-C does, and hold that it does end."""
        for process in self._background:
            process.send_signal(signal.SIGINT)
        for process in self._background:
            try:
                process.wait(30.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                raise

    def _local(self, text: str) -> str:
        text = text.replace("duralab.connect()", f'duralab.connect("{PORT}")')
        lines = [self._with_endpoint(line) for line in text.splitlines(keepends=True)]
        return "".join(lines).replace(PORT, self._endpoint)

    def _with_endpoint(self, line: str) -> str:
        """Say in a command what it leaves to the default."""
        words = line.split()
        if len(words) < 2 or words[0] != "duralab" or PORT in line:
            return line
        if words[1] == "up" and "--listen" not in words:
            return f"{line.rstrip()} --listen {PORT}\n"
        return line


@contextmanager
def page_run(folder: Path, *, endpoint: str) -> Iterator[PageRun]:
    """Run a page's blocks in a folder, and end what they left running."""
    run = PageRun(folder, endpoint=endpoint)
    try:
        yield run
    finally:
        run.end()


def fit_into_a_campaign(text: str, path: Path) -> None:
    """Hold that a part of a campaign file is taken as it stands by the shipped demo."""
    shipped = Path(duralab.__file__).with_name("campaign") / "shipped" / "front_axle_demo.yaml"
    part = yaml.safe_load(text)
    path.write_text(yaml.safe_dump(yaml.safe_load(shipped.read_text()) | part))
    loaded = duralab.load_campaign(path).model_dump(mode="json")
    for key, section in part.items():
        if isinstance(section, dict):
            assert section.keys() <= loaded[key].keys()
        else:
            assert loaded[key] == section


def words_of(command: str) -> list[str]:
    """Return the words of a command line as a shell splits them."""
    return shlex.split(command, comments=True)
