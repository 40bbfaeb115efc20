"""What is asked of a model and of another one that stands for its rig."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from duralab_bus import FaultError
from duralab_proto.arrays import from_array, to_array, to_record
from duralab_proto.v1 import identifier_pb2, query_pb2
from duralab_proto.v1.array_pb2 import Channel
from duralab_settings import SettingsError
from duralab_spectra import line_frequencies
from identifier.bus import advise, converge, drive_room
from identifier.modelling import IdentifiedModel, to_message, with_id
from identifier.service import IdentifierConfig, IdentifierService
from identifier.uncertainty import ValidBand

RATE, BLOCK = 200.0, 512
FREQUENCY = line_frequencies(BLOCK, RATE)


def model_valid(lowest, highest, *, limits=(-0.1, 0.1)):
    """Make a model of two drives and two responses that is the unit matrix in its band, and 0 outside."""
    band = ValidBand(lowest=lowest, highest=highest, sample_rate=RATE, block_samples=BLOCK)
    inside = band.lines[:, None]
    return IdentifiedModel(
        rig="front_axle",
        drives=tuple(Channel(name=f"drive_{i}", unit="m", minimum=limits[0], maximum=limits[1]) for i in range(2)),
        responses=tuple(Channel(name=f"force_{i}", unit="N", minimum=-1e4, maximum=1e4) for i in range(2)),
        sample_rate=RATE,
        frequency=FREQUENCY,
        frf=inside[..., None] * np.eye(2, dtype=complex),
        coherence=np.ones((FREQUENCY.size, 2)),
        condition_number=np.ones(FREQUENCY.size),
        residual_psd=inside * np.full(2, 1e-9),
        row_covariance=inside[..., None] * np.eye(2, dtype=complex) * 1e-3,
        interpolated=np.zeros(FREQUENCY.size, dtype=bool),
        band=band,
        drive_psd=inside * np.ones(2),
        response_psd=inside * np.ones(2),
        excitation=identifier_pb2.Excitation(),
        estimator=identifier_pb2.Estimator(),
        blocks=100,
        independent_averages=100.0,
        rig_content_hash="abc",
        run="test.identify",
        signal_epoch=1,
        signal_blocks=1,
        plan=identifier_pb2.ExperimentPlan(),
        warnings=(),
        verdicts=(),
        distortion=None,
        id=f"{lowest:g} to {highest:g} Hz",
    )


def convergence_request(lowest, highest):
    return identifier_pb2.ConvergenceRequest(
        iteration_gain=to_array(np.full(2, 0.6)), lowest_frequency=lowest, highest_frequency=highest
    )


def test_convergence_is_foretold_only_where_the_rigs_model_is_valid_too():
    model, rig = model_valid(1.0, 60.0), model_valid(5.0, 40.0)
    answer = converge(model, convergence_request(5.0, 40.0), rig=rig)
    np.testing.assert_allclose(from_array(answer.spectral_radius), 0.4, atol=1e-3)
    for lowest, highest in ((2.0, 40.0), (5.0, 50.0)):
        with pytest.raises(SettingsError, match="within that of rig model 5 to 40 Hz, 5 to 40 Hz") as refusal:
            converge(model, convergence_request(lowest, highest), rig=rig)
        assert refusal.value.field == "lowest_frequency"


def advice_request(model, **changes):
    target = np.random.default_rng(1).standard_normal((2, 4000))
    values = {"target": to_record(model.responses, RATE, target), "lowest_frequency": 5.0, "highest_frequency": 40.0}
    return identifier_pb2.AdviceRequest(**(values | changes))


@pytest.mark.parametrize("crest_factor", [0.5, -1.0, np.inf])
def test_a_crest_factor_that_is_not_allowed_is_refused_with_its_field(crest_factor):
    model = model_valid(1.0, 60.0)
    with pytest.raises(SettingsError, match="it must be 1 or more and finite") as refusal:
        advise(model, advice_request(model, crest_factor=crest_factor), room=drive_room(model))
    assert refusal.value.field == "crest_factor"


def test_a_target_that_does_not_move_is_refused_with_its_field():
    model = model_valid(1.0, 60.0)
    still = to_record(model.responses, RATE, np.ones((2, 4000)))
    with pytest.raises(SettingsError, match="does not move") as refusal:
        advise(model, advice_request(model, target=still), room=drive_room(model))
    assert refusal.value.field == "target"


def test_a_drive_without_room_is_no_fault_of_the_target():
    model = with_id(model_valid(1.0, 60.0, limits=(0.0, 0.1)))
    service = IdentifierService(MagicMock(), IdentifierConfig())
    service._cache.put(to_message(model))
    call = SimpleNamespace(progress=lambda _what, _fraction: None)
    with pytest.raises(FaultError, match="Drive drive_0 of rig 'front_axle' goes from 0 to") as fault:
        service.advice(advice_request(model, model_id=model.id), call)
    assert (fault.value.code, fault.value.field) == (query_pb2.FAULT_CODE_FAILED_PRECONDITION, "")
