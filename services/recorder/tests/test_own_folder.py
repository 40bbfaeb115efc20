"""A folder of recordings belongs to one recorder at a time."""

from __future__ import annotations

import pytest

from labbus import ConfigError
from recorder.own_folder import own_folder


def test_a_second_recorder_is_kept_out_until_the_first_has_ended(tmp_path):
    folder = tmp_path / "recordings"
    refused = pytest.raises(ConfigError, match=r"Another recorder writes in folder '.*recordings'; end it first")
    with own_folder(folder), refused, own_folder(folder):
        pytest.fail("Two recorders have one folder.")
    with own_folder(folder):
        assert not (folder / ".writable").exists()
