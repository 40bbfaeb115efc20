"""The figures of the campaigns of this process: how far each is, and how they ended."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from duralab_proto.v1 import iterator_pb2
from labbus import Metrics

_CAMPAIGN: Final = ("campaign",)
_NO_LABELS: Final[tuple[str, ...]] = ()

Statuses = Callable[[], Iterable[iterator_pb2.CampaignStatus]]


class CampaignFigures:
    """Figures of campaigns; one that has ended is only counted, so that they do not grow with the months.

    Parameters
    ----------
    metrics : Metrics
        Of the process.
    running : callable
        Returns the status of every campaign that has not ended.
    """

    def __init__(self, metrics: Metrics, running: Statuses) -> None:
        self._ended = metrics.count(
            "duralab_campaigns_ended_total", "Campaigns that ended, by phase", labels=("phase",)
        )
        metrics.follow(
            "duralab_campaigns_running", "Campaigns under way", lambda: {_NO_LABELS: float(len(list(running())))}
        )
        readings: tuple[tuple[str, str, Callable[[iterator_pb2.CampaignStatus], float | None]], ...] = (
            ("fraction", "Share of the campaign that is done", lambda status: status.fraction),
            ("playbacks", "Playbacks of the target that are done", lambda status: len(status.iterations)),
            ("relative_rms_error", "Error of the last playback over all channels", _last_error),
            ("remaining_seconds", "Expected time to the end", _remaining),
        )
        for name, what, read in readings:
            metrics.follow(
                f"duralab_campaign_{name}", what, lambda read=read: _by_campaign(running(), read), labels=_CAMPAIGN
            )

    def ended(self, status: iterator_pb2.CampaignStatus) -> None:
        """Count a campaign that ended."""
        self._ended.add(iterator_pb2.CampaignPhase.Name(status.phase).removeprefix("CAMPAIGN_PHASE_"))


def _by_campaign(
    statuses: Iterable[iterator_pb2.CampaignStatus], read: Callable[[iterator_pb2.CampaignStatus], float | None]
) -> Mapping[tuple[str, ...], float]:
    read_off = ((status.id, read(status)) for status in statuses)
    return {(id,): float(value) for id, value in read_off if value is not None}


def _last_error(status: iterator_pb2.CampaignStatus) -> float | None:
    return status.iterations[-1].overall_relative_rms_error if status.iterations else None


def _remaining(status: iterator_pb2.CampaignStatus) -> float | None:
    return status.remaining_seconds if status.remaining_seconds >= 0.0 else None
