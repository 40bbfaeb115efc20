"""What can go wrong for someone who uses the lab, each said in one sentence."""

from __future__ import annotations


class LabError(Exception):
    """The lab could not do what was asked.

    Parameters
    ----------
    message : str
        One sentence: what was wrong with which value, what is allowed, what to do.
    field : str
        Path of the value that was wrong, e.g. "update.gain"; empty where none is.
    service : str
        The service that found it, e.g. "rig_sim"; empty where none did.
    """

    def __init__(self, message: str, *, field: str = "", service: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.field = field
        self.service = service


class InputError(LabError):
    """A value that the user gave is not allowed: correct it and ask again."""


class ServiceEndedError(LabError):
    """A service of the lab ended by itself; its last log line is in the message."""


class CampaignFaultError(LabError):
    """A campaign ended before its last playback."""
