"""Target and response of a recording: comparable in one band, and not mixed up where they are in two."""

import pickle

import numpy as np
import pytest
import synthetic_campaign
import xarray

import duralab
from duralab.errors import InputError
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import iterator_pb2

STATIC = np.array([3600.0, 0.0, 0.0] * 2)[:, None]
LEVEL = 0.5
NAMES = synthetic_campaign.NAMES


@pytest.fixture(scope="module")
def messages(campaign):
    """A campaign with a static load in what is measured, its first playback at half level, its last one confirmed."""
    messages = synthetic_campaign.steps(campaign)
    for message in messages:
        if isinstance(message, iterator_pb2.CampaignSpec):
            message.target.samples.CopyFrom(to_array(campaign.target + STATIC))
        if isinstance(message, iterator_pb2.IterationStep):
            number, level = message.iteration, LEVEL if message.iteration == 1 else 1.0
            measured = level * campaign.responses[number - 1] + STATIC
            message.response.samples.CopyFrom(to_array(measured))
            message.level = level
    last = campaign.responses[-1] + 1.0
    confirmation = iterator_pb2.ConfirmationStep(
        number=1,
        run="demo.c01",
        iteration=4,
        response_in_band=to_array(synthetic_campaign.in_band(last)),
    )
    messages.insert(-2, confirmation)
    for number, (drive, response) in enumerate(zip(campaign.drives, campaign.responses, strict=True), start=1):
        level = LEVEL if number == 1 else 1.0
        messages += synthetic_campaign.signal_blocks(
            level * drive, level * response + STATIC, run=f"demo.i{number:02d}"
        )
    return messages


@pytest.fixture(scope="module")
def recording(messages, tmp_path_factory):
    path = tmp_path_factory.mktemp("compared") / "recording.mcap"
    return duralab.open(synthetic_campaign.write(path, messages))


def values(dataset):
    """Samples with the channels last but one."""
    return np.stack([dataset[name].values for name in NAMES], axis=-2)


def test_the_difference_in_band_is_the_error_that_is_judged(recording, campaign):
    target, response, error = recording.target(in_band=True), recording.responses(in_band=True), recording.error()
    judged = np.stack([synthetic_campaign.in_band(measured) for measured in campaign.responses])
    np.testing.assert_array_equal(values(target), campaign.target)
    np.testing.assert_array_equal(values(response), judged)
    difference = (target - response).transpose("run", "time")
    xarray.testing.assert_identical(difference.drop_attrs(), error.drop_attrs())
    np.testing.assert_array_equal(values(error), campaign.target - judged)
    relative = np.sqrt((error**2).mean("time") / (target**2).mean("time"))
    found = np.stack([relative[name].values for name in NAMES], axis=-1)
    np.testing.assert_allclose(found, recording.iterations.relative_rms_error, rtol=1e-12)


def test_both_have_one_layout_in_band_and_as_measured(recording, campaign):
    for in_band in (False, True):
        target, response = recording.target(in_band=in_band), recording.responses(in_band=in_band)
        assert list(target.data_vars) == list(response.data_vars) == list(NAMES)
        assert dict(response.sizes) == {"run": 4, "time": 12_000}
        assert dict(target.sizes) == {"time": 12_000}
        np.testing.assert_array_equal(target.time, response.time)
        assert list(response.iteration.values) == [1, 2, 3, 4]
        assert list(response.level.values) == [LEVEL, 1.0, 1.0, 1.0]
        for name in NAMES:
            for key in ("units", "long_name", "minimum", "maximum"):
                assert target[name].attrs[key] == response[name].attrs[key]
    np.testing.assert_array_equal(values(recording.target(in_band=False)), campaign.target + STATIC)
    np.testing.assert_array_equal(values(recording.responses())[1], campaign.responses[1] + STATIC)
    assert "run" not in recording.responses("demo.i03", in_band=True).dims
    assert "run" not in recording.error("demo.i03").dims


@pytest.mark.parametrize(
    "difference",
    [
        lambda recording: recording.target(in_band=True) - recording.responses(),
        lambda recording: recording.responses() - recording.target(in_band=True),
        lambda recording: recording.responses(in_band=True) - recording.target(in_band=False),
        lambda recording: recording.responses() - recording.error(),
        lambda recording: recording.target(in_band=True).left_vertical - recording.responses("demo.i04").left_vertical,
        lambda recording: recording.target(in_band=True).mean("time") - recording.responses().mean("time"),
        lambda recording: (
            recording.target(in_band=True).sel(time=slice(2, 3))
            - recording.responses().isel(run=-1).sel(time=slice(2, 3))
        ),
        lambda recording: recording.target.to_xarray() - recording.responses(),
        lambda recording: (
            recording.target.to_xarray().sel(channel="left_vertical") - recording.responses().left_vertical
        ),
        lambda recording: recording.target.to_xarray() - recording.playback(4).response.to_xarray(),
        lambda recording: recording.target.to_xarray().to_dataset("channel") - recording.responses(),
    ],
)
def test_the_difference_of_what_is_in_band_and_what_is_as_measured_is_refused(recording, difference):
    with pytest.raises(InputError, match=r"in band.*as measured|as measured.*in band") as refused:
        difference(recording)
    assert "the same `in_band=`" in str(refused.value)


def test_the_two_can_be_mixed_by_whom_drops_the_coordinate(recording, campaign):
    measured = recording.responses("demo.i02").drop_vars("band")
    outside = measured - recording.responses("demo.i02", in_band=True).drop_vars("band")
    expected = campaign.responses[1] + STATIC - synthetic_campaign.in_band(campaign.responses[1])
    np.testing.assert_array_equal(values(outside), expected)


def test_arrays_of_a_playback_and_of_the_target_are_compared_in_band(recording, campaign):
    error = recording.target.to_xarray() - recording.playback(3).response_in_band.to_xarray()
    np.testing.assert_array_equal(error, campaign.target - synthetic_campaign.in_band(campaign.responses[2]))
    assert recording.playback(1).level == LEVEL


def test_attributes_say_which_is_which(recording):
    in_band = {"band": "in band", "lowest_frequency": 0.7, "highest_frequency": 35.0, "static_part": "removed"}
    as_measured = {"band": "as measured", "static_part": "kept"}
    scaled, played = {"level": "divided by the level of the playback"}, {"level": "as played"}
    for dataset, expected in (
        (recording.target(in_band=True), {"quantity": "target", **in_band}),
        (recording.target(in_band=False), {"quantity": "target", **as_measured}),
        (recording.responses(in_band=True), {"quantity": "response", **in_band, **scaled}),
        (recording.responses(), {"quantity": "response", **as_measured, **played}),
        (recording.error(), {"quantity": "error", **in_band, **scaled}),
    ):
        assert expected.items() <= dataset.attrs.items()
        assert expected.items() <= dataset.right_lateral.attrs.items()
        assert dataset.band == expected["band"]
        assert ("lowest_frequency" in dataset.attrs) == ("lowest_frequency" in expected)
    assert recording.target.to_xarray().attrs.items() >= {"quantity": "target", **in_band}.items()


def test_a_confirmation_is_judged_and_other_runs_are_not(recording, campaign):
    confirmed = recording.responses("demo.c01", in_band=True)
    np.testing.assert_array_equal(values(confirmed), synthetic_campaign.in_band(campaign.responses[-1] + 1.0))
    assert (int(confirmed.iteration), float(confirmed.level)) == (0, 1.0)
    with pytest.raises(InputError, match=r"'demo.identify' was not judged.* it holds demo.i01, .*demo.c01"):
        recording.responses("demo.identify", in_band=True)
    with pytest.raises(InputError, match="in_band is 'yes'; give True or False"):
        recording.target(in_band="yes")
    with pytest.raises(InputError, match="in_band is 1; give True or False"):
        recording.responses(in_band=1)


def test_in_band_responses_of_a_file_that_was_never_finished_are_read(messages, campaign, tmp_path):
    recording = duralab.open(synthetic_campaign.write(tmp_path / "r.mcap", messages, finish=False))
    np.testing.assert_array_equal(
        values(recording.error())[2], campaign.target - synthetic_campaign.in_band(campaign.responses[2])
    )


def test_what_is_done_in_place_changes_nothing_that_is_read_later(recording, campaign):
    for read in (
        lambda: recording.responses(in_band=True),
        recording.error,
        lambda: recording.target(in_band=True),
        lambda: recording.target(in_band=False),
    ):
        before = values(read())
        changed = read()
        changed.left_vertical.values[...] = 0.0
        changed.load()
        np.testing.assert_array_equal(values(read()), before)
    np.testing.assert_array_equal(recording.target.samples, campaign.target)


def test_a_dataset_goes_to_another_process_and_into_a_file(recording, tmp_path):
    error = recording.error()
    xarray.testing.assert_identical(pickle.loads(pickle.dumps(error)), error)
    error.to_netcdf(tmp_path / "error.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "error.nc") as again:
        assert again.attrs["highest_frequency"] == 35.0
        assert str(again.band.values) == "in band"


def test_the_samples_of_what_was_committed_are_the_ones_that_are_read(recording, messages):
    (first, *_) = (message for message in messages if isinstance(message, iterator_pb2.IterationStep))
    np.testing.assert_array_equal(
        values(recording.responses("demo.i01", in_band=True)), from_array(first.response_in_band)
    )
