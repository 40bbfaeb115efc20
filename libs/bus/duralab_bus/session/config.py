"""Settings of a session on the bus."""

from __future__ import annotations

import re
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from duralab_proto.keys import Keys

_ENDPOINT = re.compile(r"(?:tcp|tls)/(?P<host>\[[0-9a-fA-F:]+\]|[A-Za-z0-9._-]+):(?P<port>\d{1,5})")

_LARGEST_PORT = 65535
_SECURED = "tls/"

LARGEST_PAYLOAD_BYTES = 512 * 2**20
"""Largest message in bytes. The largest one of the contract is an IterationStep that carries its samples: 12 + 6 rows
of float64 at 1 kHz are 144 kB per second of the test, so that 512 MiB hold an hour, and a few of them at once still fit
the memory of a small machine. Zenoh itself stops at 1 GiB."""


class BusMode(StrEnum):
    """Mode of a session."""

    PEER = "peer"
    """Connects to every other peer directly; continues when the peer that it first connected to ends."""
    ROUTER = "router"
    """Forwards messages between sessions that do not reach each other."""
    CLIENT = "client"
    """Connects to one router or peer only, and listens nowhere."""


def _check_endpoint(endpoint: str) -> str:
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None or int(match["port"]) > _LARGEST_PORT:
        raise ValueError(
            f"the endpoint {endpoint!r} is not of the form 'tcp/<host>:<port>', e.g. 'tcp/127.0.0.1:7474', "
            "or 'tls/<host>:<port>' of a secured lab"
        )
    return endpoint


def _check_remote(endpoint: str) -> str:
    if endpoint.endswith(":0"):
        raise ValueError(f"the endpoint {endpoint!r} has no port to connect to; name the one the other listens at")
    return endpoint


def _check_lab(lab: str) -> str:
    return Keys(lab).lab


Endpoint = Annotated[str, AfterValidator(_check_endpoint)]
RemoteEndpoint = Annotated[Endpoint, AfterValidator(_check_remote)]


class TlsConfig(BaseModel):
    """Certificate, private key and certificate authority of a session, as `duralab certs` makes them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # The lab's certificate authority: every member that it signed is part of the lab.
    ca: Path
    certificate: Path
    # Readable by its owner only.
    key: Path

    @classmethod
    def of(cls, identity: Path | str) -> Self:
        """Return the files of an identity `<folder>/<role>.<name>`: certificate, key, and `ca.crt` beside them."""
        path = Path(identity)
        return cls(
            ca=path.with_name("ca.crt"),
            certificate=path.with_name(f"{path.name}.crt"),
            key=path.with_name(f"{path.name}.key"),
        )


class BusConfig(BaseModel):
    """Settings of a session on the bus; the default is a peer on loopback that only this machine can reach."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # First chunk of every key after `duralab/v1`; sessions of different labs do not meet.
    lab: Annotated[str, AfterValidator(_check_lab)] = "local"
    mode: BusMode = BusMode.PEER
    # Endpoints at which it accepts others; port 0 takes a free one. Loopback only by default.
    listen: tuple[Endpoint, ...] = ("tcp/127.0.0.1:0",)
    # Endpoints of others. Every one of them must answer at the start.
    connect: tuple[RemoteEndpoint, ...] = ()
    # Longest wait of the start for the endpoints of `connect`, in seconds.
    connect_timeout_seconds: float = Field(default=5.0, gt=0, le=600)
    # Largest message sent or accepted, in bytes.
    largest_payload_bytes: int = Field(default=LARGEST_PAYLOAD_BYTES, ge=1024, le=2**30)
    # Certificate of this session and authority of the secured lab; with endpoints 'tls/…' only.
    tls: TlsConfig | None = None

    @model_validator(mode="after")
    def _check_listener(self) -> Self:
        if self.mode is BusMode.CLIENT:
            if not self.connect:
                raise ValueError("a client needs an endpoint in `connect`")
        elif not self.listen:
            # Measured: a peer without a listener received none of 200 messages, without an error.
            raise ValueError(f"a {self.mode} needs an endpoint in `listen`, e.g. 'tcp/127.0.0.1:0'")
        self._check_security()
        return self

    def _check_security(self) -> None:
        secured = [endpoint for endpoint in self.connect if endpoint.startswith(_SECURED)]
        if self.tls is None and secured:
            raise ValueError(f"the endpoint {secured[0]!r} is secured; name `ca`, `certificate` and `key` in `tls`")
        if self.tls is None:
            return
        if self.mode is not BusMode.CLIENT:
            # Access control is in the router: peers that connect directly would bypass it.
            raise ValueError(
                f"a session with `tls` must be a client of the router, not a {self.mode}; say mode: client"
            )
        if len(secured) != len(self.connect):
            raise ValueError(f"`tls` is given, but {self.connect[0]!r} is not secured; connect to 'tls/<host>:<port>'")
