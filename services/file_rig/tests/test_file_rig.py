"""A drive is played through files by a person or a controller, over the bus."""

from contextlib import closing

import numpy as np
import pytest
from file_lab import MAP, Controller, close_to, gentle, truth, until

from duralab_drive_files import Outbox, read_controller_map
from duralab_gateway import Run, RunEndedError
from duralab_proto.arrays import from_array
from duralab_proto.v1 import rig_pb2
from file_rig.file_rig import FileRig


def test_a_drive_is_played_through_files(lab):
    drive, phases, blocks = gentle(), [], []
    lab.bus.subscribe(
        lab.bus.keys.rig_signal("beam", "*"), rig_pb2.SignalBlock, lambda item: blocks.append(item.message)
    )
    with Controller(lab.map).running() as controller:
        result = lab.play("one", drive, on_progress=lambda progress: phases.append(progress.phase))
    close_to(result, truth(drive))
    assert result.alignment.lag == pytest.approx(37.4, abs=0.01)
    assert abs(result.alignment.drift) < 0.01
    assert [fit.drive for fit in result.alignment.commands] == ["lift", "push"]
    assert [fit.gain for fit in result.alignment.commands] == pytest.approx([1.005, 1.005], abs=2e-4)
    assert min(fit.correlation for fit in result.alignment.commands) > 0.9999
    assert controller.played == ["one"]
    assert any("waiting for the response file one.rsp" in phase for phase in phases)
    until(lambda: len(blocks) == result.blocks)
    assert np.array_equal(np.hstack([from_array(block.drive) for block in blocks]), drive)
    assert [path.name for path in lab.outbox.iterdir()] == ["done"]
    assert sorted(path.name for path in (lab.outbox / "done").iterdir()) == [
        "one.drv",
        "one.html",
        "one.json",
        "one.rsp",
    ]
    assert list(lab.inbox.iterdir()) == []
    told = lab.told()
    assert (told.publishes_after_run, told.cannot_be_stopped, told.simulated) == (True, False, False)
    assert [channel.name for channel in told.responses] == ["strain", "load", "twice"]
    assert told.responses[1].sensor.serial_number == "A17"


def test_a_way_in_that_is_too_steep_is_refused(tmp_path):
    path = tmp_path / "beam.yaml"
    path.write_text(MAP.replace("lead: 0.5", "lead: 0.02"))
    with closing(Outbox(read_controller_map(path))) as outbox:
        with pytest.raises(RunEndedError, match=r"push moves at .* in its lead of 0.02 s") as refused:
            FileRig(outbox).playback(np.full((2, 100), [[0.0], [19000.0]]), Run("steep"))
        assert refused.value.code_name == "INVALID_ARGUMENT"
        assert outbox.waiting() is None
