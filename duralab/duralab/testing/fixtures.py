"""Pytest fixtures: `from duralab.testing.fixtures import linear_lab, linear_rig  # noqa: F401` in a conftest.py."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from duralab.lab import Lab
from duralab.testing.labs import lab
from duralab.testing.linear_rig import LinearRig


@pytest.fixture(scope="session")
def linear_rig() -> LinearRig:
    """Return a linear rig of two drives and two responses, with a little noise; override it to use another rig."""
    return LinearRig(noise_rms=1.0)


@pytest.fixture(scope="session")
def linear_lab(linear_rig: LinearRig, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """Return a lab whose only rig is `linear_rig`, for all tests of a session."""
    with lab(linear_rig, out=tmp_path_factory.mktemp("lab")) as started:
        yield started
