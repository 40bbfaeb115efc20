"""The beam of examples/fmu_rig, compiled once for both standards, and its YAML."""

import shutil
import sys

import pytest
import yaml
from fmu_guide import EXAMPLE, document

sys.path.insert(0, str(EXAMPLE))


@pytest.fixture(scope="session")
def fmus(tmp_path_factory):
    """The FMU by its version of FMI."""
    import build_fmu

    folder = tmp_path_factory.mktemp("fmus")
    return {fmi: build_fmu.build(folder / f"{fmi}.fmu", fmi=fmi) for fmi in (2, 3)}


@pytest.fixture
def write(fmus, tmp_path):
    """Write the rig's YAML with changes of its keys, beside its FMU; return the YAML's path."""

    def write_rig(*, fmi=2, without=(), **changes):
        content = {**document(), **changes}
        path = tmp_path / "two_post.yaml"
        path.write_text(yaml.safe_dump({key: value for key, value in content.items() if key not in without}))
        shutil.copy(fmus[fmi], tmp_path / "two_post.fmu")
        return path

    return write_rig
