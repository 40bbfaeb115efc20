import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

# pytest names modules by their path from the root, "duralab.tests.conftest", and makes an empty module "duralab" for
# it, which would hide the package of that name.
if getattr(sys.modules.get("duralab"), "__file__", None) is None:
    sys.modules.pop("duralab", None)

import synthetic_campaign  # noqa: E402


@pytest.fixture(scope="session", autouse=True)
def no_lab_of_the_user(tmp_path_factory):
    """Let no test see, or end, a lab that whoever runs the tests keeps running."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session")
def campaign():
    return synthetic_campaign.make(seconds=12.0, iterations=4)


@pytest.fixture(scope="session")
def recording_path(campaign, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "recording.mcap"
    return synthetic_campaign.write(path, synthetic_campaign.steps(campaign))


@pytest.fixture
def fake_services(monkeypatch):
    """Let `python -m rig_sim` and the others start the fakes of this folder."""
    monkeypatch.setenv("PYTHONPATH", f"{HERE / 'fakes'}:{HERE}")
    return HERE / "fakes"
