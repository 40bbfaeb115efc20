"""A lab in which file_rig is a process."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from file_lab import FileLab


@pytest.fixture
def lab(tmp_path):
    lab = FileLab(tmp_path)
    lab.start()
    yield lab
    lab.close()
