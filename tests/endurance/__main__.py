"""An endurance test at full simulation speed with kills: `python -m tests.endurance [--repeats N] [--kill-every N] …`.

Prints what became of it; exit code 1 where a repeat was lost or played twice, or a recording is not whole.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

from .disturbed_test import DisturbedTest, Outcome, specification
from .killable_services import SERVICES, KillableServices
from .late_reads import EARLY, EARLY_REPEATS, late_reads, read_seconds


def main() -> int:
    """Run it as the arguments say."""
    parser = argparse.ArgumentParser(prog="make endurance", description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=20_000)
    parser.add_argument("--kill-every", type=int, default=500, help="repeats between two kills; 0: none")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sample-every", type=int, default=1000, help="repeats between two looks at the memory")
    arguments = parser.parse_args()
    begun = time.monotonic()

    def show(played: int) -> None:
        rate = played / (time.monotonic() - begun)
        memory = ", ".join(f"{name} {size:.0f}" for name, size in outcome.memory[-1][1].items())
        sys.stdout.write(f"{played:7d} repeats, {rate:5.1f} a second; MiB: {memory}\n")
        sys.stdout.flush()

    outcome = Outcome(arguments.repeats)
    with (
        tempfile.TemporaryDirectory(prefix="duralab-endurance-") as folder,
        KillableServices(Path(folder)) as services,
    ):
        short = specification(services, EARLY, repeats=EARLY_REPEATS)
        DisturbedTest(services, short, Outcome(EARLY_REPEATS)).run(kill_every=0, seed=arguments.seed)
        early = read_seconds(services, EARLY)
        begun = time.monotonic()
        spec = specification(services, "endurance", repeats=arguments.repeats)
        DisturbedTest(services, spec, outcome).run(
            kill_every=arguments.kill_every,
            seed=arguments.seed,
            on_progress=show,
            sample_every=arguments.sample_every,
        )
        reads = late_reads(services, "endurance", early)
    sys.stdout.write(f"{report(outcome)}\n{reads}\n")
    return bool(outcome.lost or outcome.doubled or outcome.findings)


def report(outcome: Outcome) -> str:
    """Return what became of it."""
    lines = [
        f"{outcome.repeats} repeats of 1 s in {outcome.seconds:.0f} s: {outcome.repeats / outcome.seconds:.1f}/s",
        f"killed: {', '.join(f'{name} {count}' for name, count in sorted(outcome.kills.items())) or 'nothing'}",
        f"lost {len(outcome.lost)}, doubled {len(outcome.doubled)}; end not known of {outcome.unknown}",
        f"{outcome.kept} kept with all samples, {outcome.alarms} alarms",
        f"{outcome.recordings} recordings, {outcome.bytes / 1e6:.1f} MB: {outcome.bytes // outcome.repeats} B each",
        f"forecast {outcome.forecast_bytes / 1e6:.1f} MB, "
        f"used {100 * outcome.bytes / outcome.forecast_bytes:.0f} % of it",
    ]
    if len(outcome.memory) >= 4:
        quarter = len(outcome.memory) // 4
        for name in SERVICES:
            sizes = [memory[name] for _, memory in outcome.memory]
            second, last = statistics.median(sizes[quarter : 2 * quarter]), statistics.median(sizes[-quarter:])
            grown = "" if outcome.kills else f"; {_slope(outcome, name):.0f} B a repeat in the second half"
            lines.append(f"memory of {name}: {second:.1f} MiB in the second quarter, {last:.1f} in the last{grown}")
    return "\n".join([*lines, *outcome.findings])


def _slope(outcome: Outcome, name: str) -> float:
    """Return by how many bytes a repeat the memory of a service grows in the second half; a kill would reset it."""
    half = outcome.memory[len(outcome.memory) // 2 :]
    played, sizes = [played for played, _ in half], [memory[name] for _, memory in half]
    return statistics.linear_regression(played, sizes).slope * 2**20


if __name__ == "__main__":
    sys.exit(main())
