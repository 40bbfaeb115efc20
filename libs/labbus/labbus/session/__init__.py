"""A session on the bus: configuration, opening, identity, rejoining after a loss, and liveliness."""

from labbus.session.callback_thread import CallbackThread
from labbus.session.config import LARGEST_PAYLOAD_BYTES, BusConfig, BusMode, TlsConfig
from labbus.session.identity import Identity, check_identity
from labbus.session.liveliness import DEBOUNCE_SECONDS, Instance, LiveCallback, LivelinessTracker, LiveWatch
from labbus.session.reintroduction import Reintroduction
from labbus.session.rejoining import BusSession, Declaration, Inbox
from labbus.session.session import LINK_SETTINGS, explain_failure, open_session

__all__ = [
    "DEBOUNCE_SECONDS",
    "LARGEST_PAYLOAD_BYTES",
    "LINK_SETTINGS",
    "BusConfig",
    "BusMode",
    "BusSession",
    "CallbackThread",
    "Declaration",
    "Identity",
    "Inbox",
    "Instance",
    "LiveCallback",
    "LiveWatch",
    "LivelinessTracker",
    "Reintroduction",
    "TlsConfig",
    "check_identity",
    "explain_failure",
    "open_session",
]
