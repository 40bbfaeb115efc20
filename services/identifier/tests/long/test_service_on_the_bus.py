import threading
import time

import numpy as np
import pytest
from identifier_on_the_bus import identifier_and_rigs, load_linear_rig

from duralab_bus import BusConfig, FaultError, open_bus
from duralab_proto.arrays import to_array, to_record
from duralab_proto.v1 import identifier_pb2, query_pb2, rig_pb2
from identifier import from_message

LAB = "identifier_test"


@pytest.fixture(scope="module")
def linear_rig():
    return load_linear_rig()


@pytest.fixture(scope="module")
def bus():
    with open_bus(BusConfig(lab=LAB), service="test") as opened:
        yield opened


@pytest.fixture(scope="module")
def lab(bus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    with identifier_and_rigs(bus, LAB, folder, rigs=("linear", "mortal"), kept_models=2) as rigs:
        yield rigs["mortal"]


def request(run, *, rig="linear", seed=1, rms=(0.005, 0.005), seconds=60.0):
    return identifier_pb2.IdentifyRequest(
        rig=rig,
        run=run,
        rig_seed=7,
        excitation=identifier_pb2.Excitation(
            kind=identifier_pb2.EXCITATION_KIND_PURE_RANDOM,
            spectrum=identifier_pb2.WhitePinkSpectrum(
                lowest_frequency=1.0, highest_frequency=50.0, corner_frequency=5.0, decibels_per_octave=6.0
            ),
            rms=to_array(np.array(rms)),
            duration=seconds,
            fade=1.0,
            seed=seed,
        ),
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=1024, overlap=0.5),
    )


def identify(bus, message, **more):
    return bus.query(bus.keys.identify(message.rig), message, identifier_pb2.Model, **more)


@pytest.mark.usefixtures("lab")
def test_a_rig_on_the_bus_is_identified_with_progress_and_the_model_can_be_fetched(bus, linear_rig):
    progress = []
    message = identify(bus, request("test.identify"), on_progress=progress.append)
    model = from_message(message)
    band = model.condition_number > 0
    true = linear_rig.true_frf(model.frequency[band])
    error = np.linalg.norm(model.frf[band] - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))
    assert np.median(error) < 0.02
    assert np.all(model.coherence[band] > 0.95)
    assert (model.rig, model.run, model.rig_content_hash) == ("linear", "test.identify", "0" * 64)
    assert [channel.name for channel in model.responses] == ["left_force", "right_force", "middle_force"]
    assert model.signal_epoch > 0
    assert model.signal_blocks == 600
    fractions = [one.fraction for one in progress]
    phases = {one.phase for one in progress}
    assert {"playing", "estimating the FRF"} <= phases
    assert "playing in real time" not in phases
    assert fractions == sorted(fractions)
    fetched = bus.query(bus.keys.model(message.id), identifier_pb2.ModelRequest(), identifier_pb2.Model)
    assert fetched == message


def at_target(run, model, linear_rig):
    """Return a request for an experiment at a target of the outer two responses."""
    message = request(run, seed=3, seconds=30.0)
    message.excitation.kind, message.excitation.capture_blocks = identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL, 2
    samples = np.random.default_rng(5).standard_normal((2, 20_000)) * np.array([[400.0], [25.0]])
    channels = [linear_rig.RESPONSES[0], linear_rig.RESPONSES[2]]
    message.shape.model.CopyFrom(model)
    message.shape.target.CopyFrom(to_record(channels, linear_rig.SAMPLE_RATE, samples))
    message.shape.lowest_frequency, message.shape.highest_frequency, message.shape.level = 2.0, 40.0, 0.5
    return message


@pytest.mark.usefixtures("lab")
def test_an_experiment_at_a_target_has_responses_of_its_level_and_counts_the_damage_of_both(bus, linear_rig):
    first = identify(bus, request("before", rms=(0.0005, 0.0005), seconds=30.0))
    message = identify(bus, at_target("shaped", first, linear_rig))
    model, before = from_message(message), from_message(first)
    assert (message.shaped_by, message.target_level) == (first.id, 0.5)
    lines = model.band.lines
    true = linear_rig.true_frf(model.frequency[lines])
    error = np.linalg.norm(model.frf[lines] - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))
    assert np.median(error) < 0.01
    spacing = model.frequency[1] - model.frequency[0]
    level = np.sqrt(model.response_psd[lines].sum(axis=0) * spacing)
    # White noise up to 500 Hz, of which the band has 38 Hz.
    np.testing.assert_allclose(level[[0, 2]], np.array([200.0, 12.5]) * np.sqrt(38.0 / 500.0), rtol=0.05)
    assert np.all(model.response_damage > before.response_damage)
    # Nothing else of the two experiments differs in what a reader sees.
    assert [channel.name for channel in model.responses] == [channel.name for channel in before.responses]


@pytest.mark.usefixtures("lab")
def test_a_shape_that_does_not_fit_the_rig_is_refused(bus, linear_rig):
    first = identify(bus, request("to-shape", seconds=30.0))

    def with_model(change):
        message = at_target("refused", first, linear_rig)
        change(message.shape)
        return message

    for change, field, text in (
        (lambda shape: setattr(shape, "level", 1.5), "shape.level", r"level of the shape is 1\.5"),
        (lambda shape: setattr(shape.model, "blocks", 7), "shape.model", "damaged or changed"),
        (lambda shape: setattr(shape.target.channels[0], "name", "torque"), "shape.target.channels", "has torque"),
        (lambda shape: setattr(shape.target, "sample_rate", 500.0), "shape.target.sample_rate", "at 500 Hz"),
        (lambda shape: setattr(shape, "lowest_frequency", 90.0), "shape.lowest_frequency", "holds no line"),
    ):
        with pytest.raises(FaultError, match=text) as fault:
            identify(bus, with_model(change))
        assert (fault.value.code, fault.value.field) == (query_pb2.FAULT_CODE_INVALID_ARGUMENT, field)


@pytest.mark.usefixtures("lab")
def test_real_time_reaches_the_rig_and_the_words_of_the_rig_reach_the_client(bus):
    message, progress = request("paced", seconds=6.5), []
    message.real_time = True
    identify(bus, message, on_progress=progress.append)
    assert "playing in real time" in {one.phase for one in progress}


@pytest.mark.usefixtures("lab")
def test_the_same_seeds_give_the_same_frf_bytes(bus):
    first, second = (identify(bus, request(f"again.{i}", seconds=20.0)) for i in range(2))
    assert first.frf == second.frf
    assert first.id != second.id
    other = identify(bus, request("again.other", seed=2, seconds=20.0))
    assert other.frf != first.frf


@pytest.mark.usefixtures("lab")
def test_a_model_that_is_not_held_is_not_found(bus):
    with pytest.raises(FaultError, match="holds no model 'deadbeef'; it keeps the 2 used last") as fault:
        bus.query(bus.keys.model("deadbeef"), identifier_pb2.ModelRequest(), identifier_pb2.Model)
    assert fault.value.code == query_pb2.FAULT_CODE_NOT_FOUND


@pytest.mark.usefixtures("lab")
@pytest.mark.parametrize(
    ("message", "code", "field", "text"),
    [
        (request("a", rig="nowhere"), query_pb2.FAULT_CODE_UNAVAILABLE, "", "nowhere"),
        (request("a", rms=(0.005,)), query_pb2.FAULT_CODE_INVALID_ARGUMENT, "excitation.rms", "has 2 drives"),
        (
            request("a", rms=(0.005, 0.05)),
            query_pb2.FAULT_CODE_INVALID_ARGUMENT,
            "excitation.rms",
            "right_vertical would reach",
        ),
        (request("a", rig="failing"), query_pb2.FAULT_CODE_FAILED_PRECONDITION, "drive.samples", "pressure was lost"),
        (request("a", rig="mistaken"), query_pb2.FAULT_CODE_DATA_LOSS, "", "answered run 'another'; asked was 'a'"),
        (request("a/b"), query_pb2.FAULT_CODE_INVALID_ARGUMENT, "run", "a/b"),
    ],
)
def test_what_cannot_be_done_comes_back_as_one_fault(bus, message, code, field, text):
    with pytest.raises(FaultError, match=text) as fault:
        identify(bus, message)
    assert (fault.value.code, fault.value.field) == (code, field)


@pytest.mark.usefixtures("lab")
def test_an_experiment_on_another_rig_than_its_key_names_is_refused(bus):
    message, keys = request("a", rig="linear"), bus.keys
    series = identifier_pb2.LevelsRequest(identify=message)
    for key, asked, kind in (
        (keys.identify("beam"), message, identifier_pb2.Model),
        (keys.identify_levels("beam"), series, identifier_pb2.LevelsResult),
    ):
        with pytest.raises(FaultError, match="is that of rig 'beam'") as fault:
            bus.query(key, asked, kind)
        assert fault.value.code == query_pb2.FAULT_CODE_INVALID_ARGUMENT
        assert fault.value.field.endswith("rig")


def test_a_client_that_gives_up_frees_the_identifier_and_a_rig_that_dies_is_reported(bus, lab):
    given_up = threading.Event()
    threading.Timer(0.5, given_up.set).start()
    with pytest.raises(FaultError) as fault:
        identify(bus, request("slow.one"), cancel=given_up)
    assert fault.value.code == query_pb2.FAULT_CODE_CANCELLED

    threading.Timer(1.0, lab.kill).start()
    started = time.monotonic()
    with pytest.raises(FaultError, match="mortal") as fault:
        identify(bus, request("slow.two", rig="mortal"))
    assert fault.value.code == query_pb2.FAULT_CODE_UNAVAILABLE
    assert time.monotonic() - started < 15.0
    # And the identifier works on, on a rig that was latched when its commander went.
    bus.query(bus.keys.rig_reset("linear"), rig_pb2.ResetRequest(), rig_pb2.RigState)
    assert identify(bus, request("after", seconds=20.0)).blocks > 0


@pytest.mark.usefixtures("lab")
def test_with_holds_the_model_has_the_gain_at_rest_and_the_same_frf(bus, linear_rig):
    plain, held = request("test.plain"), request("test.held")
    held.excitation.static_hold = 1.0
    without, model = (from_message(identify(bus, message)) for message in (plain, held))
    true = linear_rig.true_frf(np.zeros(1))[0].real
    np.testing.assert_allclose(model.static_gain, true, atol=0.01 * np.max(np.abs(true)))
    assert without.static_gain is None
    np.testing.assert_array_equal(model.frf, without.frf)
    assert model.plan.samples > without.plan.samples
