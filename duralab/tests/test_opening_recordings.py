"""What is no recording, and what is not there any more, is said in one sentence; never a Python error of its own."""

import pytest
import synthetic_campaign

import duralab
from duralab.errors import InputError


@pytest.fixture
def path(tmp_path, campaign):
    blocks = synthetic_campaign.signal_blocks(campaign.drives[0], campaign.responses[0], run="demo.i01")
    return synthetic_campaign.write(tmp_path / "r.mcap", [*synthetic_campaign.steps(campaign), *blocks])


@pytest.mark.parametrize("given", [None, 5, b"r.mcap", ["r.mcap"]])
def test_what_is_no_path_is_refused(given):
    with pytest.raises(InputError) as caught:
        duralab.open(given)
    said = f"The recording is {given!r}; give the path of an .mcap file, a text or a pathlib.Path."
    assert str(caught.value) == said


@pytest.mark.parametrize("ask", ["responses", "drives", "signal"])
@pytest.mark.parametrize("run", [["demo.i01"], 1, None, {}])
def test_a_run_that_is_no_text_is_refused_with_how_to_ask(path, ask, run):
    with pytest.raises(InputError) as caught:
        getattr(duralab.open(path), ask)(run)
    said = f"A run is {run!r}; give each name as a separate string, e.g. {ask}('demo.i01'"
    assert str(caught.value).startswith(said)


def test_a_file_that_was_deleted_since_is_said_to_be_gone(path):
    recording, other = duralab.open(path), duralab.open(path)
    dataset = recording.responses("demo.i01")
    path.unlink()
    for ask in (dataset.load, lambda: other.sha256, lambda: other.signal("demo.i01"), lambda: other._windows.runs):
        with pytest.raises(InputError, match=r"r\.mcap.*; give the path of an \.mcap file\.$"):
            ask()
