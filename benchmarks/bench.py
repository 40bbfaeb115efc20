"""Measure everything: rigs, their lanes, identification, iteration, files, bus, log, live view, a campaign, a sweep.

Writes out/bench.json, the page and the same as text: goals, met or missed, with what was measured.

`python benchmarks/bench.py [--rig NAME …] [--only PART …] [--out FILE] [--page FILE]`
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from campaign import measure_campaign
from drives import noise_drive, playable_share
from formats import measure_formats
from identification import measure_identification
from iteration import measure_iteration
from lanes import measure_lanes
from live_view import measure_live_view
from machine import ProcessorTime, machine
from page import missed, page
from processes import memory, startup_seconds
from recording import measure_recorder
from report import measure_report
from speed import drake_real_time_factor, real_time_factor, real_time_factor_of_two, relative_error
from startup import measure_lab, measure_startup
from sweep import TOLERANCES, measure_sweep

from rig_sim import Rig, load_any_rig, shipped_specimens

SECONDS = 60.0
ERROR_SECONDS = 10.0
DRAKE_SECONDS = 0.3


@dataclass(frozen=True)
class Figures:
    """Results of one rig; None if a value does not apply.

    Real-time factors are simulated seconds per wall second, `rtf_two` the sum of two rigs on two threads; `error` is
    the worst response's, relative; start-up in s, without and with a cache of bytecode; memory of a process that plays
    120 s in MiB, its growth beyond the record itself.
    """

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


def _others(scratch: Path) -> dict[str, Callable[[], object]]:
    """Return the other measurements, by their names in the file."""
    return {
        "lanes": measure_lanes,
        "identification": lambda: measure_identification(scratch / "peers"),
        "iteration": lambda: measure_iteration(scratch / "peers"),
        "formats": measure_formats,
        "startup": measure_startup,
        "lab": measure_lab,
        "report": measure_report,
        "live_view": measure_live_view,
        "recorder": lambda: _in_folder(scratch, measure_recorder),
        # As a lab's script asks: this process holds all that the parts before it imported and left, and a query took
        # twice as long from here.
        "bus": lambda: _in_a_process_of_its_own("bus.py"),
        "campaign": measure_campaign,
        "sweep": measure_sweep,
        # 40 of a thousand campaigns; only benchmarks/sweep.py measures all of them.
        "tolerances": lambda: measure_sweep(sweep=TOLERANCES, campaigns=40, turns=1),
    }


def _in_folder(scratch: Path, measure: Callable[[Path], object]) -> object:
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        return measure(Path(folder))


def _in_a_process_of_its_own(script: str) -> object:
    ran = subprocess.run(
        [sys.executable, str(Path(__file__).with_name(script))], stdout=subprocess.PIPE, check=True, text=True
    )
    return json.loads(ran.stdout)


def _measure_chosen(
    document: dict[str, Any], given: argparse.Namespace, shipped: Mapping[str, Path], *, everything: bool
) -> None:
    rigs = document["rigs"]
    for name in shipped if everything else given.rig or ():
        rigs[name] = asdict(measure(shipped[name]))
        sys.stderr.write(f"{name}: {rigs[name]['rtf']:.0f} times real time\n")
    for name, work in _others(given.out.parent).items():
        if everything or name in (given.only or ()):
            began = time.monotonic()
            document[name] = work()
            sys.stderr.write(f"{name}: measured in {time.monotonic() - began:.0f} s\n")
        # Write after each part, so that earlier results are kept if a later part fails.
        given.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


def main() -> None:
    """Measure the chosen parts, all by default, and write file, page and table."""
    shipped = shipped_specimens()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", action="append", choices=sorted(shipped), help="only this one; may be repeated")
    parser.add_argument(
        "--only", action="append", choices=list(_others(Path())), help="only this part; may be repeated"
    )
    parser.add_argument("--out", type=Path, default=Path("out/bench.json"))
    parser.add_argument("--page", type=Path, help="also write the page")
    given = parser.parse_args()
    given.out.parent.mkdir(parents=True, exist_ok=True)
    everything = not (given.rig or given.only)
    before = {} if everything or not given.out.exists() else json.loads(given.out.read_text(encoding="utf-8"))
    document: dict[str, Any] = {"rigs": {}, **before, "seconds": SECONDS, "machine": machine()}
    with ProcessorTime() as processors:
        _measure_chosen(document, given, shipped, everything=everything)
    document["machine"]["taken by its host"] = f"{100 * processors.stolen_share:.1f} %"
    given.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    if given.page:
        given.page.write_text(page(document), encoding="utf-8")
    failed = missed(document)
    sys.stdout.write(page(document) + "".join(f"\nMissed: {goal}" for goal in failed) + "\n")


if __name__ == "__main__":
    main()
