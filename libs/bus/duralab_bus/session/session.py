"""Opening a Zenoh session from a BusConfig, with errors that a user understands."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Mapping
from typing import Any, Final

import zenoh

from duralab_bus.faults import BusError
from duralab_bus.session.config import BusConfig, BusMode
from duralab_bus.session.identity import explain_refusal

# A free port is found by asking the system and giving it back; another process may take it in between.
_PORT_ATTEMPTS: Final = 5
_PROBE_SECONDS: Final = 0.5
# A link on which nothing comes for this long is closed, and with it goes the liveliness of who is frozen at its other
# end. Zenoh's own threads send a sign of life four times as often: a process is not taken for frozen because Python, or
# native code that holds the interpreter's lock, keeps it busy. Zenoh's default is 10 s.
LEASE_SECONDS: Final = 2.0
# How long a stream waits for room on a link before it drops a message there, which has to be replayed then. Once: while
# the link stays full, what follows is dropped at once.
_FULL_LINK_MICROSECONDS: Final = 8_000
# Zenoh closes a link when a receiver does not read an answer for this long. Streams never wait (they are dropped and
# replayed); a handler whose asker is frozen should not for longer than needed. It is Zenoh's own default.
_BLOCKED_LINK_MICROSECONDS: Final = 5_000_000

# Sessions find each other through the endpoints they are told, and by gossip from there on. One of two peers connects,
# not both at once: of two links made at the same time one is closed again, and what was declared on it may be gone.
_GOSSIP: Final[Mapping[str, Any]] = {
    "enabled": True,
    "autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
}

LINK_SETTINGS: Final[Mapping[str, Any]] = {
    "lease": round(LEASE_SECONDS * 1e3),
    "keep_alive": 4,
    "queue": {
        # The most that Zenoh allows, of batches of 64 KiB, for what is streamed and for questions and answers: with its
        # default, two, an answer of 2 MB took 9.4 ms in place of 8.1.
        "size": {"interactive_low": 16, "data": 16},
        "congestion_control": {
            "drop": {"wait_before_drop": _FULL_LINK_MICROSECONDS},
            "block": {"wait_before_close": _BLOCKED_LINK_MICROSECONDS},
        },
    },
}
"""How every session of a lab sends on a link, its router included."""


def open_session(config: BusConfig) -> tuple[zenoh.Session, tuple[str, ...]]:
    """Open a session.

    `config`: Mode, endpoints and certificates of the session.
    Returns: Connected to every endpoint of `config.connect`. The endpoints it accepts others at, with their actual
    ports.
    Raises `BusError`: A port is in use, nothing answers at an endpoint of `connect`, the router lets this session not
    in, a certificate or key is not usable, or Zenoh refuses the configuration.
    """
    for attempt in range(1, _PORT_ATTEMPTS + 1):
        listening = () if config.mode is BusMode.CLIENT else tuple(_with_port(endpoint) for endpoint in config.listen)
        try:
            return zenoh.open(_zenoh_config(config, listening)), listening
        except zenoh.ZError as error:
            taken = re.search(r"listener bound to (\S+):", str(error))
            chosen_here = taken is not None and taken[1] not in config.listen
            if not (chosen_here and attempt < _PORT_ATTEMPTS):
                raise BusError(explain_failure(str(error), config)) from error
    raise AssertionError("unreachable: the last attempt returns or raises")


def _zenoh_config(config: BusConfig, listening: tuple[str, ...]) -> zenoh.Config:
    return zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": config.mode.value,
                "listen": {"endpoints": listening, "timeout_ms": 0, "exit_on_failure": True},
                "connect": {
                    "endpoints": config.connect,
                    # Zenoh's default is to go on without a word, and to try again for ever.
                    "timeout_ms": round(config.connect_timeout_seconds * 1e3),
                    "exit_on_failure": True,
                    "retry": {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2},
                },
                "scouting": {"multicast": {"enabled": False}, "gossip": _GOSSIP},
                "adminspace": {"enabled": False},
                "transport": {
                    # Silent drops under a stalled receiver were reported with it.
                    "shared_memory": {"enabled": False},
                    "link": {"tx": LINK_SETTINGS, **_tls_settings(config)},
                },
            }
        )
    )


def _tls_settings(config: BusConfig) -> dict[str, Any]:
    tls = config.tls
    if tls is None:
        return {}
    return {
        # Not a second way in beside the secured one.
        "protocols": ["tls"],
        "tls": {
            "root_ca_certificate": str(tls.ca),
            "connect_certificate": str(tls.certificate),
            "connect_private_key": str(tls.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        },
    }


def _host_and_port(endpoint: str) -> tuple[str, int]:
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.strip("[]"), int(port)


def _with_port(endpoint: str) -> str:
    """Put a free port in the place of port 0: Zenoh does not tell which one it took."""
    host, port = _host_and_port(endpoint)
    if port != 0:
        return endpoint
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
            free = probe.getsockname()[1]
    except OSError as error:
        raise BusError(f"Cannot listen at {endpoint}: {error.strerror or error}; correct `listen`.") from error
    return f"{endpoint.removesuffix(':0')}:{free}"


def _answers(endpoint: str) -> bool:
    try:
        with socket.create_connection(_host_and_port(endpoint), timeout=_PROBE_SECONDS):
            return True
    except OSError:
        return False


def explain_failure(error: str, config: BusConfig) -> str:
    """Turn a Zenoh error into one sentence with the value and what to do.

    `error`: Message of Zenoh's error. `config`: Configuration of the session or router that could not be opened.
    Returns: One sentence.
    """
    if taken := re.search(r"listener bound to (\S+): \[?(.*?)(?: \(os error \d+\))? at /", error):
        if "in use" in taken[2]:
            return f"The endpoint {taken[1]} is in use by another process; end that one or choose another in `listen`."
        return f"Cannot listen at {taken[1]}: {taken[2].rpartition(': ')[2]}; correct `listen`."
    if "Unable to connect" in error:
        seconds = f"{config.connect_timeout_seconds:g} s"
        silent = [endpoint for endpoint in config.connect if not _answers(endpoint)]
        if silent:
            return f"Nothing listens at {', '.join(silent)} (tried for {seconds}); start it first or correct `connect`."
        if config.tls is not None:
            reason = explain_refusal(*_host_and_port(config.connect[0]), config.tls)
            return f"{config.connect[0]} answers but let this session not in within {seconds}: {reason}."
        return (
            f"{', '.join(config.connect)} answers but let this session not in within {seconds}; "
            "is it a Zenoh endpoint, and not that of a secured lab, which is joined at 'tls/…' with a certificate?"
        )
    reason = re.sub(r" at /\S+:\d+\.?", "", error)
    return f"Cannot open the bus: {reason}"
