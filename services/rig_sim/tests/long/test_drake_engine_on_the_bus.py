"""A rig simulator that is told to play with Drake says so, plays so, and hears a stop."""

import subprocess
import sys
import threading

import numpy as np
import pytest
import yaml

import duralab_bus
from duralab_proto.arrays import from_array, from_record, to_record
from duralab_proto.v1 import rig_pb2

WAIT = 120.0
RIG = "front_axle_compliant"


def start(folder, config, bus=None, **options):
    path = folder / "rig_sim.yaml"
    connect = {"bus": {"connect": list(bus.listening)}} if bus else {}
    path.write_text(yaml.safe_dump(config | connect))
    return subprocess.Popen([sys.executable, "-m", "rig_sim", "--config", str(path)], stderr=subprocess.PIPE, **options)


@pytest.fixture(scope="module")
def bus(tmp_path_factory):
    with duralab_bus.open_bus(service="client") as client:
        folder = tmp_path_factory.mktemp("rig")
        process = start(folder, {"rigs": [RIG], "engines": {RIG: "drake"}}, client)
        try:
            client.wait_for_live({("rig_sim", RIG)}, WAIT)
            yield client
        finally:
            process.terminate()
            process.communicate(timeout=WAIT)


def test_drake_plays_over_the_bus_what_a_notebook_gets(bus, front_axle_by_drake, front_axle_compliant):
    keys = bus.keys
    told = bus.query(keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    assert (told.engine, told.block_samples) == ("drake", 6 * front_axle_by_drake.block_samples)
    assert told.content_hash == front_axle_by_drake.content_hash
    drive = 0.005 * (1.0 - np.cos(2 * np.pi * 10.0 * np.arange(150) / 1000.0)) * np.ones((6, 1))
    request = rig_pb2.PlayRequest(run="drake", drive=to_record(told.drives, 1000.0, drive), seed=4)
    result = bus.query(keys.rig_play(RIG), request, rig_pb2.PlayResult)
    _, _, response = from_record(result.response)
    here, compiled = (rig.playback(drive, seed=4) for rig in (front_axle_by_drake, front_axle_compliant))
    for playback in (here, compiled):
        for _ in playback.blocks():
            pass
    assert response.tobytes() == here.response.tobytes()
    difference = np.abs(response - compiled.response).max(axis=1)
    assert np.all(difference > 0.0)
    assert np.all(difference < 1e-3 * np.abs(response).max(axis=1))


def test_a_stop_is_heard_while_drake_plays(bus):
    keys = bus.keys
    told = bus.query(keys.rig_description(RIG), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
    first_block = threading.Event()
    blocks, faults = [], []

    def on_block(item):
        blocks.append(item.message)
        first_block.set()

    def play():
        request = rig_pb2.PlayRequest(run="stopped", drive=to_record(told.drives, 1000.0, np.zeros((6, 20_000))))
        try:
            bus.query(keys.rig_play(RIG), request, rig_pb2.PlayResult)
        except duralab_bus.FaultError as fault:
            faults.append(fault)

    bus.subscribe(keys.rig_signal(RIG, "stopped"), rig_pb2.SignalBlock, on_block)
    thread = threading.Thread(target=play)
    thread.start()
    assert first_block.wait(WAIT)
    bus.query(keys.rig_stop(RIG), rig_pb2.StopRequest(reason="enough"), rig_pb2.RigState)
    thread.join(WAIT)
    assert [(fault.code_name, fault.message) for fault in faults] == [
        ("CANCELLED", "run 'stopped' was stopped: enough.")
    ]
    # The ramp down and its hold take 0.6 s of the rig's time; it began a few blocks after the stop.
    assert sum(message.drive.shape[1] for message in blocks) < 5000
    assert not from_array(blocks[-1].drive)[:, -1].any()
    state = bus.query(keys.rig_reset(RIG), rig_pb2.ResetRequest(), rig_pb2.RigState)
    assert state.mode == rig_pb2.RIG_MODE_IDLE


@pytest.mark.parametrize(
    ("engines", "said"),
    [
        ({"rear_axle": "drake"}, "engines: rear_axle is not a rig served here; those are front_axle_compliant."),
        ({RIG: "dracke"}, "engines.front_axle_compliant"),
        ({RIG: {"engine": "drake", "fixed_step": 0.01}}, "fixed_step is 0.01 s; a sample, 0.001 s, is the longest"),
    ],
)
def test_a_bad_engine_in_the_configuration_is_one_sentence(tmp_path, engines, said):
    process = start(tmp_path, {"rigs": [RIG], "engines": engines}, text=True)
    _, error = process.communicate(timeout=WAIT)
    assert process.returncode == 2
    assert error.count("\n") == 1
    assert said in error
