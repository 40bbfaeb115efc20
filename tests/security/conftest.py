"""A lab's certificates, and a router that knows them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from duralab.security import init_authority, issue
from duralab_proto.access import ADMIN, ROUTER, Role

from .secured_router import SecuredRouter


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    init_authority(folder)
    for role in (ROUTER, ADMIN, *Role):
        issue(folder, role, "main")
    return folder


@pytest.fixture(scope="module")
def router(certificates: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SecuredRouter]:
    with SecuredRouter(certificates, log=tmp_path_factory.mktemp("router") / "router.log") as router:
        yield router
