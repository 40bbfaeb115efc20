"""Long jobs, and the reading of uploaded files, in a separate process: `python -m operator_page.child`.

It reads one job, a pickle made by this service, from standard input, and writes a JSON document to standard output, or
a sentence to standard error. Its time and memory are bounded, and its crash does not affect the service.
"""

from __future__ import annotations

import json
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from duralab import (
    InputError,
    LabError,
    Rig,
    Signals,
    compare,
    forecast_schedule,
    open_recording,
    write_comparison,
    write_report,
)
from duralab.campaign import campaign_text, parse_campaign, template_for
from duralab.formats import read_signals, write_signals
from duralab.target import levels_by_pre_test, make_target, read_target_file
from duralab_schedules import Schedule
from operator_page.documents import signals_document

SECONDS: Final = 120
LARGEST_BYTES: Final = 6 * 2**30
_REFUSED: Final = 2


def work(job: str, *values: Any) -> dict[str, Any]:
    """Run a job in a separate process; raises LabError with its sentence if it fails."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", "operator_page.child"],
            input=pickle.dumps((job, values)),
            capture_output=True,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"It took longer than {SECONDS} s and was broken off; give a smaller file.") from None
    said = done.stderr.decode("utf-8", "replace").strip().splitlines()
    if done.returncode == _REFUSED and said:
        raise InputError(said[-1])
    if done.returncode != 0:
        raise InputError(
            "It could not be read: its process ended early, for lack of memory or for what is in the file."
        )
    return json.loads(done.stdout)


def _read(path: Path) -> dict[str, Any]:
    return signals_document(_signals(path))


def _signals(path: Path) -> Signals:
    try:
        return read_signals(path)
    except InputError as error:
        # The browser knows only the file's name.
        raise InputError(error.message.replace(str(path), path.name)) from error


def _target(text: str, folder: Path, rig: Rig) -> dict[str, Any]:
    """Return the target of a measured file before and after its editing steps, and the effect of each step."""
    plan = parse_campaign(text, name="the campaign", folder=folder)
    if plan.target.file is None:
        raise InputError("The target comes from a road; it is made when the campaign begins.", field="target")

    def play(_: Signals) -> Signals:
        raise InputError("A road is not driven for a preview.")

    edited = make_target(plan, rig=rig, vehicle=None, play=play)
    before = read_target_file(
        folder / plan.target.file, rig=rig, channels=plan.target.channels, calculated=plan.target.calculated
    )
    return {
        "before": signals_document(before.signals),
        "after": signals_document(edited.signals),
        "steps": [
            {
                "name": record.name,
                "finding": record.finding,
                "damage_kept": {
                    each.channel: each.damage_kept for each in record.channels if each.damage_kept is not None
                },
            }
            for record in edited.records
        ],
    }


def _levels(text: str, folder: Path, rig: Rig, recording: Path) -> dict[str, Any]:
    """Return the sections of a campaign that describe an identification with levels by the pulses of a pre-test."""
    plan = parse_campaign(text, name="the campaign", folder=folder)
    found = levels_by_pre_test(recording, campaign=plan, rig=rig)
    written = campaign_text(template_for(rig.name), path=folder / "new.yaml", rig=rig, levels=found)
    content = parse_campaign(written, name="new").model_dump(mode="json", exclude_unset=True)
    return {"pre_test": found.pre_test, "excitation": content["excitation"], "estimator": content["estimator"]}


def _forecast(schedule: Schedule) -> dict[str, Any]:
    """Return the forecast of a schedule: repeats, time, damage over plan, room on disk."""
    found = forecast_schedule(schedule)
    found.require_playable()
    forecast = found.forecast
    return {
        "rig": schedule.rig,
        "events": [
            [name, forecast.repeats[name], event.load.seconds, forecast.kept[name], event.source]
            for name, event in found.events.items()
        ],
        "channels": [
            [name, planned, forecast.damage.get(name), forecast.ratio[name]] for name, planned in found.planned.items()
        ],
        "repeats": sum(forecast.repeats.values()),
        "seconds": forecast.seconds,
        "bytes": forecast.bytes,
        "notes": list(found.notes),
    }


def _report(recording: Path, out: Path) -> dict[str, Any]:
    return {"path": str(write_report(recording, out))}


def _compare(recordings: list[Path], out: Path) -> dict[str, Any]:
    return {"path": str(write_comparison(out, compare(*(open_recording(each) for each in recordings))))}


def _export(recording: Path, what: str, out: Path) -> dict[str, Any]:
    opened = open_recording(recording)
    if what == "target":
        signals: Signals = opened.target
    else:
        table = opened.iterations
        if not table.numbers:
            raise InputError(f"The recording {opened.specification.id} holds no playback.")
        signals = getattr(opened.playback(table.numbers[table.best]), what)
    return {"path": str(write_signals(signals, out).path)}


JOBS: Final[Mapping[str, Callable[..., dict[str, Any]]]] = MappingProxyType(
    {
        "read": _read,
        "target": _target,
        "levels": _levels,
        "report": _report,
        "compare": _compare,
        "export": _export,
        "forecast": _forecast,
    }
)


def main() -> int:
    """Run the job on standard input."""
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (LARGEST_BYTES, LARGEST_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    job, values = pickle.load(sys.stdin.buffer)
    try:
        json.dump(JOBS[job](*values), sys.stdout, allow_nan=False)
    except LabError as error:
        sys.stderr.write(f"{error.message}\n")
        return _REFUSED
    except MemoryError:
        sys.stderr.write("It needs more memory than is allowed; give a smaller file.\n")
        return _REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main())
