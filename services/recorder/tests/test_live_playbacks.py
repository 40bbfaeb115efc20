"""The names of playbacks in the live view, also of those that a crash broke off and that were asked for again."""

from __future__ import annotations

import pytest
from printed_view import legend_of, rows_of, run_rerun

from duralab_bus import StreamItem
from duralab_proto.keys import Keys
from duralab_proto.v1 import recorder_pb2
from recorder import rebuild_view
from recorder.live import LiveView
from recorder.live.playbacks import playback_of
from recorder.log import Archive

SHOWN = ("/response", "/measured", "/drive", "/rig")


@pytest.mark.parametrize(
    ("run", "name", "entity", "is_iteration"),
    [
        ("demo.i02", "iteration 02", "iteration 02", True),
        ("demo.i02-2", "iteration 02", "iteration 02-2", True),
        ("demo.identify", "identify", "identify", False),
        ("demo.identify-2", "identify-2", "identify-2", False),
        ("demo.confirm01", "confirm01", "confirm01", False),
        ("other.i02-2", "other.i02-2", "other.i02-2", False),
    ],
)
def test_a_run_is_an_iteration_of_its_campaign_or_has_its_own_name(run, name, entity, is_iteration):
    playback = playback_of(run, recording="demo")
    assert (playback.name, playback.entity, playback.is_iteration) == (name, entity, is_iteration)


def repeated(campaign):
    """Return what flows when iteration 2 is broken off, played again, and followed by another."""
    found = [campaign.specification(), campaign.description(), campaign.target_in_band()]
    for run, number in (("demo.i01", 1), ("demo.i02", None), ("demo.i02-2", 2), ("demo.i03", 3)):
        blocks = campaign.blocks(run)
        found += [campaign.planned(run), *(blocks if number else blocks[:2])]
        if number is not None:
            step = campaign.iteration(number, 0.5 / number)
            step.run = run
            found += [campaign.poses(run), step]
    return found


@pytest.fixture
def live_file(tmp_path, campaign):
    path = tmp_path / "live.rrd"
    view = LiveView("demo", file=path, viewer=None)
    show = {"SignalBlock": view.show_block, "PoseBlock": view.show_pose}
    for message in repeated(campaign):
        show.get(message.DESCRIPTOR.name, view.show_step)(message)
    view.close()
    return path


@pytest.fixture
def rebuilt_file(tmp_path, campaign, step_of):
    archive, number, seq = Archive(tmp_path, least_free_bytes=0), 0, 0
    for message in [*repeated(campaign), recorder_pb2.RecordingClosed(reason="done")]:
        match message.DESCRIPTOR.name:
            case "SignalBlock":
                seq = 0 if message.first_sample == 0 else seq + 1
                archive.take_block(StreamItem(Keys().rig_signal(campaign.rig, message.run), 7, seq, message))
            case "PoseBlock":
                archive.take_pose(StreamItem(Keys().rig_pose(campaign.rig), 7, number, message))
            case _:
                archive.commit("demo", step_of(number, message))
                number += 1
    path = tmp_path / "again.rrd"
    assert rebuild_view.main([str(tmp_path / "demo.mcap"), "--out", str(path)]) == 0
    return path


@pytest.mark.parametrize("made", ["live_file", "rebuilt_file"])
def test_the_complete_attempt_has_the_iterations_name_in_every_tab(made, request, rerun_program, viewer_environment):
    file = request.getfixturevalue(made)

    def legend(entity):
        return legend_of(rerun_program, viewer_environment, entity, file)

    for group in ("measured", "drive", "response"):
        assert legend(f"/{group}/left_vertical/iteration\\ 02-2") == "iteration 02"
    for group in ("measured", "drive"):
        assert legend(f"/{group}/left_vertical/iteration\\ 02") == "iteration 02 (attempt 1)"
    assert legend("/measured/left_vertical/iteration\\ 03") == "iteration 03 (latest)"


def test_the_rig_moves_through_an_attempt_that_is_asked_for_again(live_file, rerun_program, viewer_environment):
    # Its forms, its rest, and 20 poses of each of the three playbacks that told them.
    assert rows_of(rerun_program, viewer_environment, "/rig/boxes", live_file) == 1 + 1 + 3 * 20


def test_a_view_made_again_draws_every_attempt_as_it_was_watched(
    live_file, rebuilt_file, rerun_program, viewer_environment
):
    entities = []
    for file in (live_file, rebuilt_file):
        printed = run_rerun(rerun_program, viewer_environment, "rrd", "print", file)
        entities.append(
            {line.split(" - ")[1] for line in printed.splitlines() if line.partition(" - ")[2].startswith(SHOWN)}
        )
    assert entities[0] == entities[1]
    rows = [rows_of(rerun_program, viewer_environment, "/rig/boxes", file) for file in (live_file, rebuilt_file)]
    assert rows[0] == rows[1]
