import queue
import threading

import numpy as np
import pytest

from duralab_proto.v1 import iterator_pb2
from iterator.campaign import CampaignBoard, seeds
from iterator.campaign.progress_estimate import Progress, ProgressEstimate


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_the_remaining_time_follows_the_durations_of_the_steps_so_far():
    clock = Clock()
    estimate = ProgressEstimate(identification_seconds=40.0, playback_seconds=20.0, iterations=3, clock=clock)
    assert estimate.at(0.0) == Progress(fraction=0.0, remaining_seconds=-1.0)
    clock.now += 2.0
    # A quarter of the identification took 2 s, so it takes 8 s, and each iteration half of that.
    assert estimate.at(0.25) == Progress(fraction=0.1, remaining_seconds=6.0 + 3 * 4.0)
    clock.now += 6.0
    estimate.step_done()
    assert estimate.at(0.0) == Progress(fraction=0.4, remaining_seconds=12.0)
    clock.now += 5.0
    estimate.step_done()
    assert estimate.at(0.0) == Progress(fraction=0.6, remaining_seconds=10.0)
    clock.now += 7.0
    assert estimate.at(0.9).remaining_seconds == 5.0
    estimate.step_done()
    clock.now += 1.0
    assert estimate.at(0.5) == Progress(fraction=0.9, remaining_seconds=5.0)


def test_seeds_are_those_of_numpy_and_all_differ():
    assert seeds.derived_seed(11, seeds.EXCITATION) == int(
        np.random.SeedSequence([11, 0]).generate_state(1, np.uint64)[0]
    )
    indices = [seeds.EXCITATION, seeds.IDENTIFICATION_PLAYBACK, *(seeds.playback(k) for k in range(1, 20))]
    assert indices == list(range(21))
    assert len({seeds.derived_seed(11, index) for index in indices}) == 21
    assert 0 <= seeds.derived_seed(2**64 - 1, 3) < 2**64


def board():
    published = []
    return CampaignBoard("try", publish=published.append), published


def test_every_change_is_published_in_order_and_the_fraction_never_falls():
    status, published = board()
    for fraction in (0.1, 0.4, 0.3, 0.5):
        status.show("working", Progress(fraction=fraction, remaining_seconds=1.0))
    assert [event.fraction for event in published] == [0.1, 0.4, 0.4, 0.5]


def test_a_status_that_does_not_change_is_repeated_until_the_end():
    published = queue.SimpleQueue()
    status = CampaignBoard("try", publish=published.put)
    status.start_publishing("campaign-status")
    for _ in range(3):
        assert published.get(timeout=60.0) is status.snapshot()
    status.end(status.final_status(iterator_pb2.CAMPAIGN_PHASE_STOPPED, "stopped"))
    for repeating in threading.enumerate():
        if repeating.name == "campaign-status":
            repeating.join(60.0)
            assert not repeating.is_alive()
    activities = [published.get().activity for _ in range(published.qsize())]
    assert activities[-1] == "stopped"
    assert activities.count("stopped") == 1


def test_nothing_follows_the_final_status():
    status, published = board()
    status.end(status.final_status(iterator_pb2.CAMPAIGN_PHASE_FINISHED, "done"))
    status.show("late", Progress(fraction=0.5, remaining_seconds=1.0))
    assert [event.activity for event in published] == ["done"]
    assert status.snapshot().fraction == 1.0
    assert status.wait_ended(0.0)


def test_a_campaign_has_ended_for_a_reader_of_its_final_status():
    # Who reads the status while it is published, and asks for a resume, must not be told that the campaign runs.
    seen = []

    def publish(event):
        reader = threading.Thread(target=lambda: seen.append(status.ended))
        reader.start()
        readers.append(reader)
        reader.join(0.05)

    readers, status = [], CampaignBoard("try", publish=publish)
    status.end(status.final_status(iterator_pb2.CAMPAIGN_PHASE_FINISHED, "done"))
    for reader in readers:
        reader.join()
    assert seen == [True]


def test_a_phase_that_goes_on_is_not_an_end():
    status, _ = board()
    with pytest.raises(ValueError, match="not final"):
        status.end(status.snapshot())


def test_a_reader_keeps_what_it_read():
    status, _ = board()
    before = status.snapshot()
    status.show("working", Progress(fraction=0.5, remaining_seconds=1.0))
    assert before.fraction == 0.0
