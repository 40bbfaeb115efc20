"""Steps of a recording come in order and page by page; a recorder that answers something else is not believed."""

import pytest

from duralab_bus import FaultError, message_of_step, recorded_steps
from duralab_proto.keys import Keys
from duralab_proto.v1 import iterator_pb2, query_pb2, recorder_pb2

_KINDS = {kind.DESCRIPTOR.full_name: kind for kind in (iterator_pb2.CampaignSpec,)}


class _Recorder:
    """Answers of a recorder; each list holds the numbers of the steps of one page."""

    def __init__(self, *pages: list[int], total: int) -> None:
        self._pages = list(pages)
        self._total = total
        self.asked: list[int] = []

    keys = Keys()

    def query(self, key: str, request: recorder_pb2.ReadStepsRequest, answer: type) -> recorder_pb2.RecordedSteps:
        self.asked.append(request.first)
        steps = [recorder_pb2.RecordedStep(step=number) for number in self._pages.pop(0)]
        return recorder_pb2.RecordedSteps(total=self._total, steps=steps)


def test_all_pages_are_read_and_only_as_many_as_are_taken():
    recorder = _Recorder([0, 1], [2, 3, 4], [5], total=6)
    steps = recorded_steps(recorder, "monday")
    assert next(steps).step == 0
    assert recorder.asked == [0]
    assert [step.step for step in steps] == [1, 2, 3, 4, 5]
    assert recorder.asked == [0, 2, 5]


def test_a_recording_without_steps_gives_none():
    assert list(recorded_steps(_Recorder([], total=0), "monday")) == []


@pytest.mark.parametrize(
    ("recorder", "why"),
    [
        (_Recorder([0, 1], [], total=3), "answered 2 of 3 steps and then nothing"),
        (_Recorder([0, 2], total=3), "answered step 2 in place of step 1"),
        (_Recorder([0, 0], total=3), "answered step 0 in place of step 1"),
    ],
)
def test_missing_and_doubled_steps_are_refused(recorder, why):
    with pytest.raises(FaultError, match=f"The recording 'monday' cannot be read back: the recorder {why}") as refused:
        list(recorded_steps(recorder, "monday"))
    assert refused.value.code == query_pb2.FAULT_CODE_DATA_LOSS


@pytest.mark.parametrize(
    ("step", "why"),
    [
        (recorder_pb2.RecordedStep(step=3, message_type="duralab.v1.Else"), "its step 3 is of the type 'duralab.v1.El"),
        (
            recorder_pb2.RecordedStep(step=4, message_type="duralab.v1.CampaignSpec", payload=b"\xff"),
            "its step 4 is not a duralab.v1.CampaignSpec",
        ),
    ],
)
def test_a_step_that_is_no_message_of_its_kind_is_refused(step, why):
    with pytest.raises(FaultError, match=why) as refused:
        message_of_step("monday", step, _KINDS, of="a campaign")
    assert refused.value.code == query_pb2.FAULT_CODE_DATA_LOSS
