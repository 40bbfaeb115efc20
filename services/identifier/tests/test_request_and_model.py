import numpy as np
import pytest

from duralab_proto.arrays import to_array
from duralab_proto.v1 import identifier_pb2, rig_pb2
from duralab_proto.v1.array_pb2 import Channel
from identifier import (
    RigUnderTest,
    SettingError,
    check_against_rig,
    content_hash,
    estimate_experiment,
    from_message,
    make_drive,
    to_message,
)
from identifier.request import model_of, settings_of


def request(**changes):
    message = identifier_pb2.IdentifyRequest(
        rig="front_axle",
        run="test.identify",
        excitation=identifier_pb2.Excitation(
            kind=identifier_pb2.EXCITATION_KIND_PURE_RANDOM,
            spectrum=identifier_pb2.WhitePinkSpectrum(
                lowest_frequency=0.5, highest_frequency=50.0, corner_frequency=5.0, decibels_per_octave=6.0
            ),
            rms=to_array(np.array([0.01, 0.02])),
            duration_seconds=20.0,
            fade_seconds=1.0,
            seed=2**64 - 1,
        ),
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=1024, overlap=0.5),
    )
    for path, value in changes.items():
        *parents, leaf = path.split("__")
        target = message
        for parent in parents:
            target = getattr(target, parent)
        if leaf == "rms":
            target.rms.CopyFrom(to_array(np.asarray(value, dtype=float)))
        else:
            setattr(target, leaf, value)
    return message


RIG = RigUnderTest.from_message(
    rig_pb2.RigDescription(
        rig="front_axle",
        sample_rate=1000.0,
        drives=[Channel(name=f"drive_{i}", unit="m", minimum=-0.1, maximum=0.1) for i in range(2)],
        responses=[Channel(name=f"force_{i}", unit="N", minimum=-1e4, maximum=1e4) for i in range(3)],
        longest_drive_seconds=600.0,
        content_hash="abc",
    )
)


def plan(message):
    settings = settings_of(message)
    check_against_rig(settings, RIG)
    return make_drive(settings, RIG)


def test_a_sound_request_passes_every_check():
    assert plan(request()).shape == (2, 20_000)


@pytest.mark.parametrize(
    ("changes", "field", "message"),
    [
        ({"rig": "Front Axle"}, "rig", "Front Axle"),
        ({"rig": ""}, "rig", "rig"),
        ({"run": "a/b"}, "run", "a/b"),
        ({"excitation__kind": 0}, "excitation.kind", "kind 0"),
        ({"estimator__kind": 7}, "estimator.kind", "kind 7"),
        ({"excitation__rms": [0.01]}, "excitation.rms", "1 RMS values were given; .* 2 drives"),
        ({"excitation__rms": [0.01, 0.0]}, "excitation.rms", "RMS of drive 1 is 0.0"),
        ({"excitation__rms": [0.01, np.nan]}, "excitation.rms", "nan"),
        ({"excitation__rms": [[0.01, 0.01]]}, "excitation.rms", "shape"),
        ({"excitation__rms": [0.01, 0.05]}, "excitation.rms", "drive_1 would reach .* limit of"),
        ({"excitation__spectrum__highest_frequency": 500.0}, "excitation.spectrum.highest_frequency", "below 500 Hz"),
        ({"excitation__spectrum__highest_frequency": np.nan}, "excitation.spectrum.highest_frequency", "nan"),
        ({"excitation__spectrum__lowest_frequency": 0.0}, "excitation.spectrum.highest_frequency", "above 0"),
        ({"excitation__spectrum__corner_frequency": 60.0}, "excitation.spectrum.corner_frequency", "60.0 Hz"),
        ({"excitation__spectrum__decibels_per_octave": -3.0}, "excitation.spectrum.decibels_per_octave", "-3.0 dB"),
        ({"excitation__duration_seconds": np.inf}, "excitation.duration_seconds", "inf s"),
        ({"excitation__duration_seconds": 601.0}, "excitation.duration_seconds", "at most 600 s"),
        ({"excitation__duration_seconds": 4.0}, "excitation.duration_seconds", "4 are needed for 2 drives, so take"),
        ({"excitation__fade_seconds": 10.0}, "excitation.fade_seconds", "less than half"),
        ({"excitation__fade_seconds": -1.0}, "excitation.fade_seconds", "0 or more"),
        ({"estimator__block_samples": 255}, "estimator.block_samples", "255 samples"),
        ({"estimator__block_samples": 2**31}, "estimator.block_samples", "between the fades"),
        ({"estimator__overlap": 1.0}, "estimator.overlap", "less than 1"),
        ({"estimator__overlap": np.nan}, "estimator.overlap", "nan"),
        (
            {"estimator__overlap": 0.9999, "excitation__duration_seconds": 600.0, "estimator__block_samples": 8192},
            "estimator.overlap",
            "smaller overlap",
        ),
        (
            {
                "excitation__spectrum__corner_frequency": 0.6,
                "excitation__spectrum__highest_frequency": 0.7,
            },
            "estimator.block_samples",
            "none in the band",
        ),
    ],
)
def test_what_is_not_allowed_is_refused_with_its_field(changes, field, message):
    with pytest.raises(SettingError, match=message) as refusal:
        plan(request(**changes))
    assert refusal.value.field == field
    assert str(refusal.value).endswith(".")


def test_the_duration_asked_for_is_enough():
    short = request(excitation__duration_seconds=4.0, estimator__overlap=0.75)
    with pytest.raises(SettingError) as refusal:
        check_against_rig(settings_of(short), RIG)
    asked = float(str(refusal.value).split("take ")[1].split(" s or")[0])
    check_against_rig(settings_of(request(excitation__duration_seconds=asked, estimator__overlap=0.75)), RIG)


def test_a_static_response_does_not_reach_the_estimate():
    settings = settings_of(request())
    drive = make_drive(settings, RIG)
    gain = np.array([[1e5, 2e4], [0.0, 3e5], [5e4, -1e5]])
    estimates = [
        estimate_experiment(settings, drive=drive, response=gain @ drive + offset, sample_rate=1000.0)
        for offset in (0.0, 3600.0)
    ]
    band = estimates[0].condition_number > 0
    np.testing.assert_allclose(estimates[1].frf, estimates[0].frf, atol=1e-7 * 3e5)
    np.testing.assert_allclose(estimates[1].frf[band], np.broadcast_to(gain, (band.sum(), 3, 2)), atol=1e-7 * 3e5)


def test_the_fades_are_dropped():
    settings = settings_of(request())
    drive = make_drive(settings, RIG)
    response = np.vstack([drive, drive[:1]])
    spoilt = response.copy()
    spoilt[:, :1000] = 1e6
    spoilt[:, -1000:] = -1e6
    first, second = (
        estimate_experiment(settings, drive=drive, response=r, sample_rate=1000.0) for r in (response, spoilt)
    )
    np.testing.assert_array_equal(first.frf, second.frf)


def make_model():
    settings = settings_of(request())
    drive = make_drive(settings, RIG)
    noise = np.random.default_rng(0).standard_normal((3, drive.shape[1]))
    response = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) @ drive + 0.001 * noise
    estimate = estimate_experiment(settings, drive=drive, response=response, sample_rate=1000.0)
    return model_of(request(), rig=RIG, estimate=estimate, played=rig_pb2.PlayResult(epoch=2**63 + 1, blocks=200))


def test_a_model_survives_the_bus_unchanged():
    model = make_model()
    message = identifier_pb2.Model.FromString(to_message(model).SerializeToString())
    again = from_message(message)
    assert again.id == model.id == content_hash(message)
    assert (again.signal_epoch, again.signal_blocks) == (2**63 + 1, 200)
    for name in ("frequency", "frf", "coherence", "condition_number", "drive_psd", "response_psd"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    assert again.frf.shape == (513, 3, 2)


def test_the_same_experiment_gives_the_same_id_and_any_change_another():
    assert make_model().id == make_model().id
    message = to_message(make_model())
    for change in (lambda m: setattr(m, "blocks", 1), lambda m: setattr(m.drives[0], "unit", "mm")):
        changed = identifier_pb2.Model.FromString(message.SerializeToString())
        change(changed)
        with pytest.raises(ValueError, match="damaged or changed"):
            from_message(changed)


@pytest.mark.parametrize(
    "description",
    [
        rig_pb2.RigDescription(rig="x", sample_rate=float("nan"), drives=[Channel()], responses=[Channel()]),
        rig_pb2.RigDescription(rig="x", sample_rate=1000.0),
        rig_pb2.RigDescription(rig="x", sample_rate=1000.0, drives=[Channel(), Channel()], responses=[Channel()]),
    ],
)
def test_a_description_that_cannot_be_worked_with_is_refused(description):
    with pytest.raises(ValueError, match="Rig 'x'"):
        RigUnderTest.from_message(description)
