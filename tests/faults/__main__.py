"""Faults at random moments in real labs: `python -m tests.faults [--fault NAME …] [--rounds N] [--soak MINUTES] …`.

Prints a table and writes it to out/faults.json; exit code 1 where anything was lost or did not recover.
"""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import tempfile
import time
from pathlib import Path

import structlog

from duralab_proto.keys import Keys

from .disturbed_campaign import Round
from .fault_kinds import FAULTS, FULL, SHORT
from .fault_table import file_table, soak_table, table, tally_table, write_figures
from .file_faults import FileRounds, pairs_of_faults, perform, single_faults
from .file_faults_at_gateway import perform_at_gateway
from .lab_under_fault import LabUnderFault
from .malformed_queries import Tally, query_keys, send_to_lab
from .reference import make_reference
from .rounds import Rounds, perform_all
from .soak import Soak, soak

MALFORMED_QUERIES = "malformed queries"
FILE_EXCHANGE = "file exchange"
_ROUNDS_AT_GATEWAY = 3
_ITERATIONS = 8


def _arguments() -> argparse.Namespace:
    names = [kind.name for kind in FAULTS]
    parser = argparse.ArgumentParser(prog="make faults", description=__doc__.splitlines()[0])
    parser.add_argument(
        "--fault",
        action="append",
        choices=[*names, MALFORMED_QUERIES, FILE_EXCHANGE],
        metavar="NAME",
        help=f"only these: {', '.join([*names, MALFORMED_QUERIES, FILE_EXCHANGE])}",
    )
    parser.add_argument("--rounds", type=int, default=20, help="of each fault (20)")
    parser.add_argument("--seed", type=int, default=1, help="decides all moments, durations and messages (1)")
    parser.add_argument("--messages", type=int, default=1000, help="malformed queries of each kind to each key (1000)")
    keys = [key.name for key in query_keys(Keys())]
    parser.add_argument(
        "--key",
        action="append",
        choices=keys,
        default=[],
        metavar="NAME",
        help=f"malformed queries to these keys only: {', '.join(keys)}",
    )
    parser.add_argument("--soak", type=float, default=None, metavar="MINUTES", help="30 where no fault is named")
    parser.add_argument("--short", action="store_true", help="faults of up to 3 s in place of 60 s")
    parser.add_argument("--out", type=Path, default=Path("out/faults.json"), help="where the figures go")
    return parser.parse_args()


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _tell(outcome: Round) -> None:
    what = "; ".join(outcome.findings) or f"{outcome.ending.value}, recovered in {outcome.recovered_seconds:.1f} s"
    _say(f"{outcome.fault} {outcome.number} ({outcome.detail}): {what}")


def _exchange_files(folder: Path, *, rounds: int, seed: int) -> list[FileRounds]:
    def tell(done: FileRounds) -> None:
        _say(f"{done.fault}: {done.right} of {done.rounds} judged rightly")

    # The gateway of the simulated rig is a part of this process.
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.WARNING))
    return [
        *perform([()], folder / "clean", rounds=10 * rounds, seed=seed, tell=tell),
        *perform(single_faults(), folder / "faults", rounds=rounds, seed=seed, tell=tell),
        *perform(pairs_of_faults(), folder / "pairs", rounds=rounds, seed=seed, tell=tell),
        *perform_at_gateway(folder / "gateway", rounds=min(rounds, _ROUNDS_AT_GATEWAY), seed=seed, tell=tell),
    ]


def _disturb_labs(
    options: argparse.Namespace, wanted: list[str], folder: Path, *, minutes: float
) -> tuple[list[Rounds], dict[str, Tally] | None, Soak | None]:
    reference = make_reference(folder / "reference", iterations=_ITERATIONS)
    _say(f"the undisturbed campaign takes {reference.seconds:.1f} s")
    results = perform_all(
        [kind for kind in FAULTS if kind.name in wanted],
        reference,
        folder,
        rounds=options.rounds,
        seed=options.seed,
        scale=SHORT if options.short else FULL,
        tell=_tell,
    )
    tallies = None
    if MALFORMED_QUERIES in wanted:
        with LabUnderFault(folder / "malformed_queries") as lab:
            tallies = send_to_lab(lab, reference, seed=options.seed, each=options.messages, only=options.key, tell=_say)
    return results, tallies, soak(reference, folder / "soak", minutes=minutes) if minutes > 0 else None


def main() -> int:
    options = _arguments()
    wanted = options.fault or [*(kind.name for kind in FAULTS), MALFORMED_QUERIES, FILE_EXCHANGE]
    minutes = options.soak if options.soak is not None else (0.0 if options.fault else 30.0)
    began = time.monotonic()
    # As an interrupt does: the labs are ended, and the small disk is taken away.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    results: list[Rounds] = []
    exchanged: list[FileRounds] = []
    tallies = long_run = None
    with tempfile.TemporaryDirectory(prefix="duralab-faults-", ignore_cleanup_errors=True) as temporary:
        folder = Path(temporary)
        if FILE_EXCHANGE in wanted:
            exchanged = _exchange_files(folder / "file_exchange", rounds=options.rounds, seed=options.seed)
        if set(wanted) != {FILE_EXCHANGE} or minutes > 0:
            results, tallies, long_run = _disturb_labs(options, wanted, folder, minutes=minutes)
    write_figures(options.out, results, seed=options.seed, tallies=tallies, soak=long_run, exchanged=exchanged)
    _say("")
    findings = [finding for result in [*results, *exchanged] for finding in result.findings]
    if results:
        _say(table(results))
    if exchanged:
        _say(file_table(exchanged))
    if tallies is not None:
        _say(tally_table(tallies))
        findings += [finding for tally in tallies.values() for finding in tally.findings]
    if long_run is not None:
        _say(soak_table(long_run))
        findings += long_run.findings
    _say("\n".join(["", *findings, f"{len(findings)} findings in {(time.monotonic() - began) / 60:.0f} min"]))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
