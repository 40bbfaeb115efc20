"""Where the wall time of a campaign went, by what its iterator said that it was doing; out of its recording."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mcap.reader import make_reader

from duralab_proto.v1 import iterator_pb2, recorder_pb2

_ACTIVITIES: Final = {
    "identifying": "on_the_rig",
    "playing": "on_the_rig",
    "inverting": "computing",
    "computing": "computing",
    "storing": "storing",
}
"""First word of an activity to what it is: of a playback its judgement is a part, of an identification its estimate."""


def seconds_by_activity(recording: Path, *, began: float, ended: float) -> dict[str, float]:
    """Divide the wall time of a campaign that was waited for.

    Parameters
    ----------
    recording : Path
        Its closed file.
    began, ended : float
        When it was asked for, and when its recording was there, in s since 1970.

    Returns
    -------
    dict
        Seconds `on_the_rig`, `computing`, `storing`, and `around`: what is before the first activity and after the
        last, which is the check of the campaign and the copy of its recording. They add up to the whole.
    """
    spent = dict.fromkeys(["on_the_rig", "computing", "storing", "around"], 0.0)
    doing, since = "around", began
    for word, at in _events(recording):
        spent[doing] += at - since
        doing, since = _ACTIVITIES.get(word, "around"), at
    spent[doing] += ended - since
    return spent


def _events(recording: Path) -> list[tuple[str, float]]:
    """Return the first word of every activity, and when it was written; an empty one when the recording is closed."""
    event, closed = iterator_pb2.CampaignEvent, recorder_pb2.RecordingClosed.DESCRIPTOR.full_name
    found: list[tuple[str, float]] = []
    with recording.open("rb") as stream:
        for schema, _, message in make_reader(stream).iter_messages():
            name = "" if schema is None else schema.name
            if name == event.DESCRIPTOR.full_name:
                activity = event.FromString(message.data).status.activity
                found.append((activity.partition(" ")[0], message.log_time / 1e9))
            elif name == closed:
                found.append(("", message.log_time / 1e9))
    return found
