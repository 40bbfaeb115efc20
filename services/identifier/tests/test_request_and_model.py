from dataclasses import replace

import numpy as np
import pytest
import rainflow

from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import identifier_pb2, rig_pb2
from duralab_proto.v1.array_pb2 import Channel
from duralab_settings import EstimatorKind, EstimatorSettings, ExcitationKind, SettingsError
from identifier import (
    ModelWarning,
    RigUnderTest,
    WarningCode,
    check_against_rig,
    content_hash,
    estimate_experiment,
    from_message,
    make_experiment,
    to_message,
)
from identifier.bus import settings_of
from identifier.modelling import distortion_of, model_of


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
            duration=20.0,
            fade=1.0,
            seed=2**64 - 1,
        ),
        estimator=identifier_pb2.Estimator(kind=identifier_pb2.ESTIMATOR_KIND_H1, block_samples=1024, overlap=0.5),
    )
    for path, value in changes.items():
        *parents, leaf = path.split("__")
        target = message
        for parent in parents:
            target = getattr(target, parent)
        if leaf in ("rms", "peak"):
            getattr(target, leaf).CopyFrom(to_array(np.asarray(value, dtype=float)))
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
    return make_experiment(settings.excitation, RIG)


def multisine(**changes):
    return request(
        excitation__kind=identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL,
        **{"excitation__capture_blocks": 2, "excitation__duration": 30.0, **changes},
    )


def test_a_sound_request_passes_every_check():
    assert plan(request()).drive.shape == (2, 20_000)


@pytest.mark.parametrize("kind", list(ExcitationKind))
def test_every_kind_of_excitation_can_be_asked_for(kind):
    number = identifier_pb2.ExcitationKind.Value(f"EXCITATION_KIND_{kind.name}")
    message = request(excitation__kind=number, excitation__fade=0.1, excitation__rms=[0.005, 0.005])
    assert settings_of(message).excitation.kind is kind
    assert plan(message).drive.shape[0] == 2


@pytest.mark.parametrize("kind", list(EstimatorKind))
def test_every_estimator_can_be_asked_for(kind):
    number = identifier_pb2.EstimatorKind.Value(f"ESTIMATOR_KIND_{kind.name}")
    settings = settings_of(request(estimator__kind=number, estimator__local_order=3))
    assert (settings.estimator.kind, settings.estimator.local_order) == (kind, 3)


def test_drives_of_different_kinds_have_spectra_of_their_own_and_levels_may_be_peaks():
    message = multisine(excitation__peak=[0.03, 0.02])
    message.excitation.ClearField("rms")
    shape = message.excitation.spectrum
    message.excitation.drive_spectra.add().white_pink.CopyFrom(shape)
    table = message.excitation.drive_spectra.add().table
    table.frequency.CopyFrom(to_array(np.array([0.5, 10.0, 50.0])))
    table.density.CopyFrom(to_array(np.array([1.0, 1.0, 0.01])))
    message.excitation.ClearField("spectrum")
    experiment = plan(message)
    np.testing.assert_allclose(np.max(np.abs(experiment.drive), axis=1), [0.03, 0.02], rtol=1e-12)
    lines = np.abs(np.fft.rfft(experiment.drive[:, experiment.layout.captures[0].start :][:, :1024]))
    frequency = experiment.layout.frequency
    at = [int(np.argmin(np.abs(frequency - f))) for f in (2.0, 48.0)]
    # 6 dB per octave over the 3.26 octaves from 5 to 48 Hz, and the table's -20 dB at 50 Hz.
    np.testing.assert_allclose((lines[:, at[1]] / lines[:, at[0]]) ** 2, [10 ** (-0.6 * 3.26), 0.0125], rtol=0.1)
    table.density.CopyFrom(to_array(np.array([1.0, -1.0, 0.01])))
    with pytest.raises(SettingsError, match=r"table.density.1 is -1.0; it must be greater than 0") as refusal:
        settings_of(message)
    assert refusal.value.field == "excitation.drive_spectra.1.table.density.1"


@pytest.mark.parametrize(
    ("changes", "field", "message"),
    [
        ({"rig": "Front Axle"}, "rig", "Front Axle"),
        ({"rig": ""}, "rig", "rig"),
        ({"run": "a/b"}, "run", "a/b"),
        ({"excitation__kind": 0}, "excitation.kind", r"is 0; offered are PURE_RANDOM \(1\)"),
        ({"estimator__kind": 7}, "estimator.kind", r"is 7; offered are H1 \(1\)"),
        ({"estimator__kind": identifier_pb2.ESTIMATOR_KIND_H2}, "estimator.kind", "3 responses and 2 drives; H2"),
        ({"estimator__local_order": 7}, "estimator.local_order", "is 7; it must be less than or equal to 6"),
        ({"excitation__peak": [0.01, 0.01]}, "excitation.peak", "an rms or a peak .* and not both"),
        ({"excitation__odd_lines": True}, "excitation.odd_lines", "only a multisine"),
        ({"excitation__rms": [0.01]}, "excitation.rms", "1 RMS values were given; .* 2 drives"),
        ({"excitation__rms": [0.01, 0.0]}, "excitation.rms.1", "is 0.0; it must be greater than 0"),
        ({"excitation__rms": []}, "excitation.rms", "at least 1 item"),
        ({"excitation__rms": [0.01, np.nan]}, "excitation.rms", "nan"),
        ({"excitation__rms": [[0.01, 0.01]]}, "excitation.rms", "shape"),
        ({"excitation__rms": [0.01, 0.05]}, "excitation.rms", "drive_1 would reach .* limit of"),
        ({"excitation__spectrum__highest_frequency": 500.0}, "excitation.spectrum.highest_frequency", "below 500 Hz"),
        ({"excitation__spectrum__highest_frequency": np.nan}, "excitation.spectrum.highest_frequency", "nan"),
        (
            {"excitation__spectrum__lowest_frequency": 0.0},
            "excitation.spectrum.lowest_frequency",
            "is 0.0; it must be gr",
        ),
        (
            {"excitation__spectrum__corner_frequency": 60.0},
            "excitation.spectrum.corner_frequency",
            "corner at 60 Hz; it must lie",
        ),
        ({"excitation__spectrum__decibels_per_octave": -3.0}, "excitation.spectrum.decibels_per_octave", "is -3.0"),
        ({"excitation__duration": np.inf}, "excitation.duration", "inf; it must be a finite"),
        ({"excitation__duration": 601.0}, "excitation.duration", "at most 600 s"),
        ({"excitation__duration": 4.0}, "excitation.duration", "4 are needed for 2 drives, so take"),
        ({"excitation__fade": 10.0}, "excitation.fade", "nothing would be left"),
        ({"excitation__fade": -1.0}, "excitation.fade", "greater than or equal to 0"),
        ({"estimator__block_samples": 255}, "estimator.block_samples", "is 255; it must be"),
        ({"estimator__block_samples": 2**31}, "estimator.block_samples", "less than or equal to 1048576"),
        ({"estimator__overlap": 1.0}, "estimator.overlap", "less than 1"),
        ({"estimator__overlap": np.nan}, "estimator.overlap", "nan"),
        ({"estimator__block_samples": 2**20}, "estimator.block_samples", "between the fades"),
        (
            {"estimator__overlap": 0.9999, "excitation__duration": 600.0, "estimator__block_samples": 8192},
            "estimator.overlap",
            "smaller overlap",
        ),
        (
            {
                "excitation__spectrum__corner_frequency": 0.6,
                "excitation__spectrum__highest_frequency": 0.7,
            },
            "estimator.block_samples",
            "none to excite from",
        ),
    ],
)
def test_what_is_not_allowed_is_refused_with_its_field(changes, field, message):
    with pytest.raises(SettingsError, match=message) as refusal:
        plan(request(**changes))
    assert refusal.value.field == field
    assert str(refusal.value).endswith(".")


def test_the_duration_asked_for_is_enough():
    short = request(excitation__duration=4.0, estimator__overlap=0.75)
    with pytest.raises(SettingsError) as refusal:
        check_against_rig(settings_of(short), RIG)
    asked = float(str(refusal.value).split("take ")[1].split(" s or")[0])
    check_against_rig(settings_of(request(excitation__duration=asked, estimator__overlap=0.75)), RIG)


def test_a_multisine_that_does_not_fit_is_refused_with_its_field():
    with pytest.raises(SettingsError, match="realisations of") as refusal:
        plan(multisine(excitation__realisations=50))
    assert refusal.value.field == "excitation.duration"


ESTIMATOR = EstimatorSettings(block_samples=1024)


@pytest.mark.parametrize("message", [request(), multisine()])
def test_a_static_response_does_not_reach_the_estimate(message):
    experiment = plan(message)
    gain = np.array([[1e5, 2e4], [0.0, 3e5], [5e4, -1e5]])
    estimates = [
        estimate_experiment(
            ESTIMATOR, experiment.layout, drive=experiment.drive, response=gain @ experiment.drive + offset
        )
        for offset in (0.0, 3600.0)
    ]
    band = estimates[0].valid
    np.testing.assert_allclose(estimates[1].frf, estimates[0].frf, atol=1e-7 * 3e5)
    np.testing.assert_allclose(estimates[1].frf[band], np.broadcast_to(gain, (band.sum(), 3, 2)), atol=1e-7 * 3e5)


def test_a_channel_that_lies_is_told_with_the_values_that_were_measured():
    experiment = plan(request())
    response = np.vstack([experiment.drive, experiment.drive[:1]]) * 1e5 + 3600.0
    lowest = float(np.quantile(response[1], 0.1))
    response[1] = np.maximum(response[1], lowest)
    (warning,) = estimate_experiment(ESTIMATOR, experiment.layout, drive=experiment.drive, response=response).warnings
    assert f"flat tops at {lowest:g} or {response[1].max():g};" in warning.sentence
    response[2] = 5000.0
    with pytest.raises(ValueError, match="response 2 stays at 5000; check"):
        estimate_experiment(ESTIMATOR, experiment.layout, drive=experiment.drive, response=response)


def test_the_fades_are_dropped():
    experiment = plan(request())
    response = np.vstack([experiment.drive, experiment.drive[:1]])
    spoilt = response.copy()
    spoilt[:, :1000] = 1e6
    spoilt[:, -1000:] = -1e6
    first, second = (
        estimate_experiment(ESTIMATOR, experiment.layout, drive=experiment.drive, response=r)
        for r in (response, spoilt)
    )
    np.testing.assert_array_equal(first.frf, second.frf)


def make_model(message=None, *, warnings=()):
    message = message or request()
    settings, experiment = settings_of(message), plan(message)
    drive, layout = experiment.drive, experiment.layout
    noise = np.random.default_rng(0).standard_normal((3, drive.shape[1]))
    response = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) @ drive + 0.001 * noise
    found = estimate_experiment(settings.estimator, layout, drive=drive, response=response)
    return model_of(
        message,
        settings=settings.excitation,
        rig=RIG,
        layout=layout,
        estimate=replace(found, warnings=(*found.warnings, *warnings)),
        static=None,
        played=rig_pb2.PlayResult(epoch=2**63 + 1, blocks=200),
        response=response,
        levels=distortion_of(drive, response, layout),
    )


def test_a_warning_names_its_channel_and_its_band():
    smoothed = ModelWarning(WarningCode.SMOOTHED, "Response 1 bends.", channel=1, size=0.3, band=(19.5, 20.5))
    clipped = ModelWarning(WarningCode.CLIPPED, "Drive 1 is clipped.", channel=1, of_drive=True, size=0.01)
    stuck = ModelWarning(WarningCode.STUCK, "Response 0 is stuck.", channel=0, size=0.3)
    warnings = to_message(make_model(warnings=(smoothed, clipped, stuck))).warnings
    told = [(one.code, one.channel, one.lowest_frequency, one.highest_frequency) for one in warnings]
    assert told == [
        (identifier_pb2.MODEL_WARNING_CODE_SMOOTHED, "force_1", 19.5, 20.5),
        (identifier_pb2.MODEL_WARNING_CODE_CLIPPED, "drive_1", 0.0, 0.0),
        (identifier_pb2.MODEL_WARNING_CODE_STUCK, "force_0", 0.0, 0.0),
    ]


@pytest.mark.parametrize("message", [request(), multisine(), multisine(excitation__odd_lines=True)])
def test_a_model_survives_the_bus_unchanged(message):
    model = make_model(message)
    message = identifier_pb2.Model.FromString(to_message(model).SerializeToString())
    again = from_message(message)
    assert again.id == model.id == content_hash(message)
    assert (again.signal_epoch, again.signal_blocks) == (2**63 + 1, 200)
    for name in (
        "frequency",
        "frf",
        "coherence",
        "condition_number",
        "residual_psd",
        "row_covariance",
        "frf_variance",
        "interpolated",
        "drive_psd",
        "response_psd",
        "response_damage",
    ):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    assert again.frf.shape == (513, 3, 2)
    assert (again.band, again.verdicts, again.plan) == (model.band, model.verdicts, model.plan)
    assert message.plan.samples > 0
    np.testing.assert_array_equal(from_array(message.frf_variance), model.frf_variance)


def test_a_model_states_the_damage_of_its_whole_record_as_measured():
    model = make_model()
    drive = plan(request()).drive
    # As `make_model` makes the first response.
    noise = np.random.default_rng(0).standard_normal((3, drive.shape[1]))
    cycles = list(rainflow.count_cycles(drive[0] + 0.001 * noise[0]))
    expected = [sum(count * range_**slope for range_, count in cycles) for slope in (3.0, 5.0, 8.0)]
    np.testing.assert_allclose(model.response_damage[0], expected, rtol=1e-9)


def test_a_model_of_an_older_recording_states_no_damage():
    message = to_message(replace(make_model(), response_damage=None))
    message.id = content_hash(message)
    assert from_message(message).response_damage is None


def test_a_model_says_how_linear_the_rig_is():
    together, apart, unknown = make_model(), make_model(multisine()), make_model(multisine(excitation__realisations=1))
    assert len(together.verdicts) == len(apart.verdicts) == 3
    assert together.distortion is None
    few = make_model(request(excitation__duration=6.5))
    share = np.sqrt(np.sum(few.residual_psd, axis=0) / np.sum(few.response_psd[few.band.lines], axis=0))
    assert few.verdicts[0].startswith("Unexplained ")
    assert f"{100.0 * share[0]:.2g} % over the band" in few.verdicts[0]
    assert unknown.verdicts[0].startswith("This experiment does not show how linear force 0 is: ")
    assert apart.distortion is not None
    assert apart.verdicts[0].startswith("No nonlinearity beyond the noise in force 0; noise ")
    noise = from_array(apart.distortion.noise_psd)
    assert np.mean(noise[noise > 0.0]) == pytest.approx(2.0 * 0.001**2 / 1000.0, rel=0.1)


def test_lines_left_out_are_laid_between_their_neighbours_and_marked():
    model = make_model(multisine(excitation__odd_lines=True, excitation__detection_share=0.2))
    known = (model.frequency >= model.band.lowest) & (model.frequency <= model.band.highest)
    assert np.all(np.abs(model.frf[known, 0, 0]) > 0.9)
    np.testing.assert_array_equal(model.interpolated & ~known, False)
    # Every even line, and a fifth of the odd ones.
    assert np.mean(model.interpolated[known]) == pytest.approx(0.6, abs=0.03)
    line = int(
        np.flatnonzero(model.interpolated & np.roll(~model.interpolated, 1) & np.roll(~model.interpolated, -1))[3]
    )
    np.testing.assert_allclose(model.frf[line], (model.frf[line - 1] + model.frf[line + 1]) / 2.0, rtol=1e-12)
    assert np.all(model.frf_variance[known] > 0.0)


def test_the_plan_is_what_is_played():
    message = multisine(excitation__odd_lines=True)
    experiment, model = plan(message), make_model(message)
    assert model.plan.samples == experiment.drive.shape[1]
    assert model.plan.duration_seconds == experiment.drive.shape[1] / 1000.0
    assert model.plan.lines == int(experiment.layout.excited.sum())
    assert (model.plan.lowest_frequency, model.plan.highest_frequency) == (model.band.lowest, model.band.highest)
    assert (model.plan.blocks, model.plan.independent_averages) == (model.blocks, model.independent_averages)


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
