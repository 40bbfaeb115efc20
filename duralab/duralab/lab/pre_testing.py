"""Pre-test of a rig on a script's request."""

from __future__ import annotations

from datetime import UTC, datetime
from numbers import Real

from duralab.arguments import require_seed, require_switch, require_text
from duralab.data import PreTest, Rig
from duralab.errors import InputError
from duralab.lab.client import Deadline, LabClient
from duralab.lab.playing import halting
from duralab.lab.progress import OnProgress, RunProgress, Stage
from duralab_proto.v1 import iterator_pb2, query_pb2


def make_pre_test(
    ask: LabClient,
    rig: Rig,
    *,
    id: str | None,
    level: float,
    seed: int,
    real_time: bool,
    on_progress: OnProgress,
    deadline: Deadline,
) -> PreTest:
    """Make the pre-test of a rig; see `Lab.pre_test`."""
    require_seed(seed)
    require_switch(real_time, field="real_time")
    if id is not None:
        require_text(id, field="id")
    if isinstance(level, bool) or not isinstance(level, Real) or not float(level) > 0.0:
        raise InputError(f"level is {level!r}; give a share of the limits, above 0 to 0.05.", field="level")
    name = id or f"{rig.name}-pre-test-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
    request = iterator_pb2.PreTestRequest(
        id=name, rig=rig.name, level=float(level), seed=seed, real_time=bool(real_time)
    )

    def report(progress: query_pb2.Progress) -> None:
        # The detail contains the sentence about a calibration.
        activity = progress.detail if progress.phase == "checking" else progress.phase
        on_progress(RunProgress(Stage.PRE_TEST, activity, progress.fraction, progress.remaining_seconds))

    for sentence in rig.overdue:
        on_progress(RunProgress(Stage.PRE_TEST, sentence, 0.0, -1.0, lasting=True))
    key = ask.key("rig", ask.bus.keys.pre_test, rig.name)
    with halting(ask, rig.name, deadline):
        answer = ask.query(
            key,
            request,
            iterator_pb2.PreTest,
            on_progress=report,
            deadline=deadline,
            what=f"The pre-test of rig {rig.name!r}",
        )
    return PreTest.from_message(answer)
