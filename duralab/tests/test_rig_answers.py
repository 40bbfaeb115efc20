"""What a rig answers to a drive is believed where it is the answer to that drive, and nowhere else."""

import dataclasses

import numpy as np
import pytest
from test_labelled_signals import CHANNELS, RIG

from duralab.data import Signals
from duralab.errors import LabError
from duralab.lab.playing import play_drive
from duralab_proto.keys import Keys
from duralab_proto.v1 import rig_pb2

WITH_RESPONSES = dataclasses.replace(RIG, responses=CHANNELS)


class Gateway:
    """Answers every drive with what it is given, under the run that was asked for or another."""

    def __init__(self, response, run):
        self.bus, self.keys, self._response, self._run = self, Keys(), response, run

    def key(self, what, make, name):
        del what
        return make(name)

    def query(self, key, request, kind, **how):
        del key, kind, how
        return rig_pb2.PlayResult(run=self._run or request.run, response=self._response.to_message())


def play(response, run=""):
    options = {"run": "mine", "seed": 1, "real_time": False, "on_progress": print, "deadline": None}
    return play_drive(Gateway(response, run), WITH_RESPONSES, np.zeros((2, 10)), **options)


SOUND = Signals(CHANNELS, 500.0, np.arange(20.0).reshape(2, 10))


def test_the_answer_to_the_drive_is_returned():
    np.testing.assert_array_equal(play(SOUND).response.samples, SOUND.samples)


@pytest.mark.parametrize(
    ("response", "run", "said", "field"),
    [
        (SOUND, "other", "run 'other', asked was 'mine'", "run"),
        (dataclasses.replace(SOUND, channels=CHANNELS[::-1]), "", "b, a at 500 Hz, not its responses a, b", "response"),
        (Signals(CHANNELS[:1], 500.0, SOUND.samples[:1]), "", "a at 500 Hz, not its responses a, b", "response"),
        (dataclasses.replace(SOUND, sample_rate=250.0), "", "a, b at 250 Hz, not its responses a, b", "response"),
        (dataclasses.replace(SOUND, samples=SOUND.samples[:, :7]), "", "7 samples to a drive of 10", "samples"),
    ],
)
def test_another_answer_is_refused(response, run, said, field):
    with pytest.raises(LabError) as caught:
        play(response, run)
    assert str(caught.value).startswith(f"The rig 'rig' answered {said}")
    assert str(caught.value).endswith("; see what `duralab check-rig rig` finds.")
    assert caught.value.field.endswith(field)


def test_a_damaged_response_is_refused(monkeypatch):
    record = SOUND.to_message()
    record.samples.data = record.samples.data[:-8]
    monkeypatch.setattr(Signals, "to_message", lambda signals: record)
    with pytest.raises(LabError, match=r"^The rig 'rig' answered a damaged response: ") as caught:
        play(SOUND)
    assert caught.value.field.startswith("response")
