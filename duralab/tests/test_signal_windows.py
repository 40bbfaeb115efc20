import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import synthetic_campaign

import duralab
from duralab.errors import InputError
from duralab_recordings import windows

RUN = "demo.i01"


def write(path, campaign, blocks, **options):
    return synthetic_campaign.write(path, [*synthetic_campaign.steps(campaign), *blocks], **options)


@pytest.fixture(scope="module")
def blocks(campaign):
    return [
        synthetic_campaign.signal_blocks(drive, response, run=f"demo.i{number:02d}")
        for number, (drive, response) in enumerate(zip(campaign.drives, campaign.responses, strict=True), start=1)
    ]


@pytest.fixture(scope="module")
def path(campaign, blocks, tmp_path_factory):
    every = [block for run in blocks for block in run]
    return write(tmp_path_factory.mktemp("windows") / "r.mcap", campaign, every, chunk_size=50_000)


@pytest.fixture
def chunks_read(monkeypatch):
    read = []
    original = windows._read

    def counting(place):
        read.append(place)
        return original(place)

    monkeypatch.setattr(windows, "_read", counting)
    return read


def test_a_window_is_what_was_played_and_measured(path, campaign):
    recording = duralab.open(path)
    for dataset, written in ((recording.drives(RUN), campaign.drives), (recording.responses(RUN), campaign.responses)):
        window = dataset.isel(time=slice(1234, 2345))
        assert tuple(window.data_vars) == synthetic_campaign.NAMES
        np.testing.assert_array_equal(window.to_array().values, written[0][:, 1234:2345])
        np.testing.assert_array_equal(window.time, np.arange(1234, 2345) / synthetic_campaign.RATE)


def test_all_iterations_are_one_dataset(path, campaign):
    dataset = duralab.open(path).responses()
    assert dataset.sizes["run"] == 4
    assert list(dataset.iteration.values) == [1, 2, 3, 4]
    third = dataset.isel(run=int(np.argmax(dataset.iteration.values == 3)))
    np.testing.assert_array_equal(third.left_lateral, campaign.responses[2][1])
    expected = np.stack(campaign.responses)[1:3, 0, 50:10:-7]
    np.testing.assert_array_equal(dataset.left_vertical[1:3, 50:10:-7], expected)


@pytest.mark.parametrize("time", [3, slice(0, 10), slice(10, 0), slice(50, 10, -7), slice(None)])
@pytest.mark.parametrize("run", [slice(0, 0), slice(4, 9), slice(1, 3), 2])
def test_a_selection_has_the_shape_that_numpy_gives_it(path, campaign, run, time):
    selected = duralab.open(path).responses().left_vertical.isel(run=run, time=time).values
    np.testing.assert_array_equal(selected, np.stack(campaign.responses)[:, 0][run, time], strict=True)


def test_channels_carry_unit_name_and_limits(path):
    recording = duralab.open(path)
    response = recording.responses(RUN).left_vertical
    assert response.attrs["units"] == "N"
    channel = recording.rig.responses[0]
    assert (response.attrs["minimum"], response.attrs["maximum"]) == (channel.minimum, channel.maximum)
    assert recording.drives(RUN).left_vertical.attrs["units"] == "m"
    assert recording.drives(RUN).time.attrs["units"] == "s"


def test_opening_a_dataset_reads_no_more_than_the_ends_of_its_runs_and_a_window_no_more_than_itself(path, chunks_read):
    dataset = duralab.open(path).responses(RUN)
    assert len(chunks_read) == 1
    chunks_read.clear()
    dataset.isel(time=slice(6000, 6100)).load()
    # Six channels of a window that lies in one or two chunks, beside the first, which tells the size of a block.
    assert len(chunks_read) <= 3


def remove_the_mean(dataset):
    for name in dataset.data_vars:
        dataset[name] -= dataset[name].mean()


def remove_the_mean_of_loaded(dataset):
    dataset.load()
    remove_the_mean(dataset)


def assign_to_samples(dataset):
    for name in dataset.data_vars:
        dataset[name][..., 3:7] = 1e9


def work_on_the_arrays(dataset):
    for name in dataset.data_vars:
        samples = dataset[name].values
        samples -= 1e9


@pytest.mark.parametrize(
    "work_in_place", [remove_the_mean, remove_the_mean_of_loaded, assign_to_samples, work_on_the_arrays]
)
@pytest.mark.parametrize("runs", [(RUN,), (RUN, "demo.i03")])
@pytest.mark.parametrize("time", [slice(None), slice(1234, 2345), slice(2345, 1234, -7)])
def test_what_a_user_does_in_place_changes_nothing_that_is_read_anew(path, campaign, runs, time, work_in_place):
    recording = duralab.open(path)
    for ask, written in ((recording.drives, campaign.drives), (recording.responses, campaign.responses)):
        work_in_place(ask(*runs).isel(time=time))
        expected = np.stack([written[int(run[-2:]) - 1][:, time] for run in runs], axis=1)
        read = ask(*runs).isel(time=time).to_array().values
        np.testing.assert_array_equal(read.reshape(expected.shape), expected)


def test_what_is_assigned_before_it_is_read_is_read_back(path, campaign):
    dataset = duralab.open(path).responses(RUN)
    dataset.left_vertical[10:20] = 0.0
    expected = campaign.responses[0][0].copy()
    expected[10:20] = 0.0
    np.testing.assert_array_equal(dataset.left_vertical, expected)


def test_a_window_that_is_kept_cannot_be_written_to(path):
    window = duralab.open(path)._windows.read(RUN, 50, 250)
    for samples in (window.drive, window.response):
        with pytest.raises(ValueError, match="read-only"):
            samples[0, 0] = 1.0


@pytest.mark.parametrize(("first", "last"), [(150, 151), (199, 201), (50, 250), (200, 300), (0, 12000)])
def test_a_window_holds_its_samples_and_no_more(path, first, last):
    window = duralab.open(path)._windows.read(RUN, first, last)
    for samples in (window.drive, window.response):
        assert samples.shape == (6, last - first)
        assert samples.base is None


def test_threads_read_from_one_dataset(path, campaign, monkeypatch):
    # So few bytes that each thread drops what another has just read.
    monkeypatch.setattr(windows, "CACHE_BYTES", 3000)
    dataset = duralab.open(path).responses(RUN)
    with ThreadPoolExecutor(4) as pool:
        read = list(pool.map(lambda first: dataset.left_vertical[first : first + 50].values, [0, 40, 80] * 40))
    for first, samples in zip([0, 40, 80] * 40, read, strict=True):
        np.testing.assert_array_equal(samples, campaign.responses[0][0, first : first + 50])


def test_a_dataset_goes_to_another_process_without_the_windows_that_are_kept(path, campaign):
    dataset = duralab.open(path).responses(RUN)
    before = len(pickle.dumps(dataset))
    assert dataset.left_vertical.mean() != 0.0
    copied = pickle.dumps(dataset)
    assert len(copied) < before + 1000
    np.testing.assert_array_equal(pickle.loads(copied).left_vertical, campaign.responses[0][0])


def test_a_block_that_came_late_is_found(tmp_path, campaign, blocks):
    late = [*blocks[0][:3], *blocks[0][4:], blocks[0][3]]
    recording = duralab.open(write(tmp_path / "r.mcap", campaign, late, chunk_size=50_000))
    window = recording.responses(RUN).isel(time=slice(250, 450))
    np.testing.assert_array_equal(window.to_array().values, campaign.responses[0][:, 250:450])


def test_a_missing_block_is_reported_where_it_is_asked_for_and_only_there(tmp_path, campaign, blocks):
    recording = duralab.open(write(tmp_path / "r.mcap", campaign, [*blocks[0][:3], *blocks[0][4:]], chunk_size=50_000))
    dataset = recording.responses(RUN)
    np.testing.assert_array_equal(dataset.isel(time=slice(0, 300)).left_vertical, campaign.responses[0][0, :300])
    with pytest.raises(InputError, match=r"lacks the samples 300 to 399 of the run 'demo.i01'"):
        dataset.isel(time=slice(250, 450)).load()


def test_a_recording_split_into_files_is_one(tmp_path, campaign, blocks):
    write(tmp_path / "r.mcap", campaign, blocks[0][:7])
    synthetic_campaign.write(tmp_path / "r.part02.mcap", blocks[0][7:])
    window = duralab.open(tmp_path / "r.mcap").responses(RUN).isel(time=slice(650, 750))
    np.testing.assert_array_equal(window.to_array().values, campaign.responses[0][:, 650:750])


def test_runs_of_different_lengths_are_not_put_together(tmp_path, campaign, blocks):
    short = synthetic_campaign.signal_blocks(
        campaign.drives[1][:, :500], campaign.responses[1][:, :500], run="demo.i02"
    )
    recording = duralab.open(write(tmp_path / "r.mcap", campaign, [*blocks[0], *short]))
    with pytest.raises(InputError, match=r"differ in length or sample rate \(demo.i01 12 s, demo.i02 0.5 s\)"):
        recording.responses("demo.i01", "demo.i02")


def test_an_unknown_run_names_those_there_are(path):
    with pytest.raises(InputError, match=r"holds no signals of a run 'x'; it holds demo.i01, demo.i02"):
        duralab.open(path).responses("x")


def test_a_file_without_an_index_says_what_to_do(tmp_path, campaign, blocks):
    path = write(tmp_path / "r.mcap", campaign, blocks[0], finish=False)
    with pytest.raises(InputError, match="start the recorder on its folder again, which repairs it"):
        duralab.open(path).responses(RUN)


def test_figures_are_a_dataset_over_iterations_and_channels(path, campaign):
    figures = duralab.open(path).iterations.to_xarray()
    np.testing.assert_array_equal(
        figures.relative_rms_error.sel(iteration=2, channel="right_lateral"), campaign.errors[1][4]
    )
    assert list(figures.slope.values) == [3, 5, 8]
