"""Configuration of the operator page."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from duralab_bus import ServiceConfig

DEFAULT_PORT = 7480


class PageTls(BaseModel):
    """Certificate and private key of the page for browsers, PEM."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    certificate: Path
    key: Path
    # Authority of the lab, `ca.crt`: people may sign in with its certificates if an account names them.
    client_ca: Path | None = None


class PageConfig(ServiceConfig):
    """Configuration of the operator page."""

    # Address to listen at. An address other than loopback needs `tls` and `accounts`.
    host: str = "127.0.0.1"
    # 0 selects a free port.
    port: int = Field(default=DEFAULT_PORT, ge=0, le=65535)
    tls: PageTls | None = None
    # Names of the page for browsers, in addition to `host` and localhost: a request to another name is refused.
    names: tuple[str, ...] = ()
    # Accounts file; if not given, every user of this machine is the local operator.
    accounts: Path | None = None
    # Time after which a person has to sign in again.
    session_hours: float = Field(default=12.0, gt=0, le=168)
    # Folder of campaign files, uploads and reports; made if it does not exist.
    folder: Path = Path("page")
    # Largest file that a browser may upload.
    largest_upload_mebibytes: int = Field(default=256, ge=1, le=4096)
    # Page of Rerun's web viewer that is shown beside a rig, e.g. http://127.0.0.1:9090/?url=...
    viewer: str | None = Field(default=None, pattern=r"^https?://[A-Za-z0-9.\-\[\]:]+/[!-~]*$")

    @model_validator(mode="after")
    def _check_security(self) -> Self:
        try:
            loopback = ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            raise ValueError(f"host is {self.host!r}; give the number of an address, e.g. 127.0.0.1") from None
        if not loopback and (self.tls is None or self.accounts is None):
            raise ValueError(f"host is {self.host}, which others reach; give `tls` and `accounts`, or host 127.0.0.1")
        if self.tls is not None and self.tls.client_ca is not None and self.accounts is None:
            raise ValueError("tls.client_ca is given; give `accounts`, which say whose certificates may sign in")
        if self.bus.tls is not None and self.accounts is None:
            raise ValueError("the lab is secured (`bus.tls`); give `accounts`, so that people sign in")
        return self
