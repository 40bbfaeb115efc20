"""Campaigns across hosts that are disturbed: `python -m tests.multihost [--only NAME …] [--rounds N] [--seed N]`.

Prints a table and writes it to out/multihost.json; exit code 1 where a campaign did not end with the bytes of one
machine, or anything was lost. Exit code 0 with the reason where this machine cannot have such hosts.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import sys
import tempfile
import time
import zlib
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import numpy as np

from .host_network import HostNetwork, why_not

_ITERATIONS = 4
_CLONE_NEWNET = 0x40000000


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _move_to(namespace: str) -> None:
    """Make this process one of a host: before any of its threads begins."""
    libc = ctypes.CDLL(None, use_errno=True)
    with Path("/run/netns", namespace).open() as handle:
        if libc.setns(handle.fileno(), _CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), f"cannot enter the network namespace {namespace}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make multihost", description=__doc__.splitlines()[0])
    parser.add_argument("--only", action="append", metavar="NAME", help="only these disturbances")
    parser.add_argument("--rounds", type=int, default=1, help="of each (1)")
    parser.add_argument("--seed", type=int, default=1, help="decides moments, durations and lost frames (1)")
    parser.add_argument("--out", type=Path, default=Path("out/multihost.json"), help="where the figures go")
    return parser.parse_args()


def main() -> int:
    options = _arguments()
    if reason := why_not():
        _say(f"Not possible here: {reason}.")
        return 0
    with ExitStack() as stack:
        network = stack.enter_context(HostNetwork(f"duralab{os.getpid()}", seed=options.seed))
        _move_to(network.namespace("control"))
        # Only now: what opens sessions begins threads.
        from ..faults.disturbed_campaign import Operator, Round
        from ..faults.reference import make_reference
        from .disturbances import DISTURBANCES
        from .lab_on_hosts import LabOnHosts

        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="duralab-multihost-")))
        reference = make_reference(folder / "reference", iterations=_ITERATIONS)
        _say(f"on one machine the campaign takes {reference.seconds:.1f} s")
        lab = stack.enter_context(LabOnHosts(folder / "lab", network))
        wanted = [each for each in DISTURBANCES if not options.only or each.name in options.only]
        rounds: list[Round] = []
        for kind in wanted:
            for number in range(options.rounds):
                random = np.random.default_rng([options.seed, zlib.crc32(kind.name.encode()), number])
                outcome = Round(kind.name.replace(",", ""), number)
                began = time.monotonic()
                with ExitStack() as lifted:
                    detail = kind.bring(lab, random, lifted) if kind.before else ""
                    operator = Operator(lab, reference, outcome)
                    moment = 0.0 if kind.before else float(random.uniform(0.2, reference.seconds))
                    bring = kind.bring
                    operator.perform(
                        lambda open_end, detail=detail, bring=bring, random=random: (
                            detail or bring(lab, random, open_end)
                        ),
                        moment=moment,
                    )
                what = "; ".join(outcome.findings) or f"the bytes of one machine, {outcome.ending.value}"
                _say(f"{kind.name} ({outcome.detail}): {what}; {time.monotonic() - began:.1f} s")
                rounds.append(outcome)
        viewed = lab.viewed_blocks()
        findings = [finding for outcome in rounds for finding in outcome.findings] + lab.defects()
    if viewed == 0:
        findings.append("the viewer saw nothing")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    figures = {"seed": options.seed, "viewed_blocks": viewed, "rounds": [asdict(outcome) for outcome in rounds]}
    options.out.write_text(json.dumps(figures, indent=1) + "\n")
    lost = sum(outcome.lost + outcome.doubled + outcome.reordered for outcome in rounds)
    _say(f"{len(rounds)} campaigns, {lost} blocks lost, doubled or out of order; the viewer saw {viewed} blocks")
    _say("\n".join([*findings, f"{len(findings)} findings"]))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
