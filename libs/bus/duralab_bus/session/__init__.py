"""Session on the bus: configuration, opening, identity, rejoining after a loss, and liveliness."""

from duralab_bus.session.config import LARGEST_PAYLOAD_BYTES, BusConfig, BusMode, TlsConfig
from duralab_bus.session.liveliness import DEBOUNCE_SECONDS, Instance, LivelinessTracker
from duralab_bus.session.reintroduction import Reintroduction
from duralab_bus.session.rejoining import BusSession, Declaration, Inbox
from duralab_bus.session.session import (
    LINK_SETTINGS,
    Identity,
    check_identity,
    explain_failure,
    member_of,
    open_session,
)

__all__ = [
    "DEBOUNCE_SECONDS",
    "LARGEST_PAYLOAD_BYTES",
    "LINK_SETTINGS",
    "BusConfig",
    "BusMode",
    "BusSession",
    "Declaration",
    "Identity",
    "Inbox",
    "Instance",
    "LivelinessTracker",
    "Reintroduction",
    "TlsConfig",
    "check_identity",
    "explain_failure",
    "member_of",
    "open_session",
]
