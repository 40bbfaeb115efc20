"""A round of each fault of a controller that exchanges files; `make faults` plays twenty, also at `file_rig`."""

from pathlib import Path

import pytest

from ..faults.file_faults import pairs_of_faults, perform, single_faults


def test_a_clean_response_is_taken_as_it_was_played(tmp_path: Path):
    (done,) = perform([()], tmp_path, rounds=5, seed=7)
    assert (done.right, done.findings) == (5, [])


@pytest.mark.parametrize("faults", single_faults(), ids=lambda faults: faults[0].name.lower())
def test_a_fault_of_the_controller_is_found_and_named(faults, tmp_path: Path):
    (done,) = perform([faults], tmp_path, rounds=1, seed=7)
    assert (done.right, done.findings) == (1, [])


def test_two_faults_do_not_hide_each_other(tmp_path: Path):
    pairs = pairs_of_faults()[::8]
    done = perform(pairs, tmp_path, rounds=1, seed=7)
    assert [finding for each in done for finding in each.findings] == []
