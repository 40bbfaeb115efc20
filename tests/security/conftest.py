"""A lab's certificates, and a router that knows its members."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from .members import secured_folder
from .secured_router import SecuredRouter


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return secured_folder(tmp_path_factory.mktemp("certificates"))


@pytest.fixture(scope="module")
def router(certificates: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecuredRouter]:
    with SecuredRouter(certificates, log=tmp_path_factory.mktemp("router") / "router.log") as router:
        yield router
