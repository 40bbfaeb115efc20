"""Proposals and decisions at hold points."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from duralab.data.signals import Signals
from duralab.display import text_table
from duralab_proto.v1 import iterator_pb2
from duralab_settings import DecisionKind

_NANOSECONDS = 1e9


@dataclass(frozen=True)
class ProposedDrive:
    """Use of the rig by one drive of a proposal.

    Parameters
    ----------
    channel : str
        Name of the drive.
    peak, slew : float
        Largest magnitude and rate of change, in the drive's unit and per second.
    range_share, slew_share : float
        Shares of its range and of its slew limit, 1 at the limit; the second is 0 without a slew limit.
    change : float
        RMS of the change from the drive that it follows, over that drive's RMS; 1 for a first drive.
    """

    channel: str
    peak: float
    slew: float
    range_share: float
    slew_share: float
    change: float


@dataclass(frozen=True)
class ProposedResponse:
    """Prediction for one controlled response of a proposal, in the control band.

    Parameters
    ----------
    channel : str
        Name of the response.
    relative_rms_error, peak_ratio : float
        Predicted values, defined as for the judgement after a playback.
    damage_ratio : tuple of float
        Predicted damage ratios for S-N lines of slope 3, 5 and 8.
    uncertainty : float
        RMS of the possible deviation from the predicted response, over the target's RMS; NaN if unknown.
    """

    channel: str
    relative_rms_error: float
    peak_ratio: float
    damage_ratio: tuple[float, ...]
    uncertainty: float


@dataclass(frozen=True, eq=False)
class Proposal:
    """Proposed next playback, which waits for a decision; prints as tables.

    Parameters
    ----------
    number : int
        Number of the proposal, from 1, for `Lab.decide`.
    playback : int
        Number of the proposed playback.
    reason : str
        Reason why the campaign waits.
    level : float
        Share of the target that the drive is made for.
    follows : int
        Playback that the drive was made from; 0 for a first drive.
    drives : tuple of ProposedDrive
        Use of all drives of the rig.
    responses : tuple of ProposedResponse
        Predictions for the controlled responses.
    overall_error : float
        Predicted error over all controlled responses.
    remarks : tuple of str
        Remarks on limits that the drive would have exceeded.
    refusal : str
        Reason why no drive could be made with the present settings, so that nothing can be played; empty otherwise.
    drive : Signals or None
        Drive; None if it was not fetched.
    predicted : np.ndarray or None, shape (responses, samples)
        Predicted responses in the control band, divided by the level.
    scenario : str
        Campaign file with the changes made at hold points so far.
    """

    number: int
    playback: int
    reason: str
    level: float
    follows: int
    drives: tuple[ProposedDrive, ...]
    responses: tuple[ProposedResponse, ...]
    overall_error: float
    remarks: tuple[str, ...] = ()
    refusal: str = ""
    drive: Signals | None = None
    predicted: np.ndarray | None = None
    scenario: str = ""

    @classmethod
    def from_message(cls, message: iterator_pb2.Proposal) -> Proposal:
        """Decode a proposal, with its samples if it has them."""
        from duralab_proto.arrays import from_array

        has_samples = message.HasField("drive")
        return cls(
            number=message.number,
            playback=message.playback,
            reason=message.reason,
            level=message.level,
            follows=message.follows,
            drives=tuple(
                ProposedDrive(use.channel, use.peak, use.slew, use.range_share, use.slew_share, use.change)
                for use in message.drives
            ),
            responses=tuple(
                ProposedResponse(
                    response.channel,
                    response.forecast.relative_rms_error,
                    response.forecast.peak_ratio,
                    tuple(response.forecast.damage_ratio),
                    response.forecast.uncertainty,
                )
                for response in message.responses
            ),
            overall_error=message.overall_relative_rms_error,
            remarks=tuple(message.remarks),
            refusal=message.refusal,
            drive=Signals.from_message(message.drive, field="drive") if has_samples else None,
            predicted=from_array(message.predicted_response, field="predicted_response") if has_samples else None,
            scenario=message.scenario,
        )

    def __str__(self) -> str:
        """Return the proposal as text."""
        made_from = f"made from playback {self.follows}" if self.follows else "the first"
        head = f"Proposal {self.number}: the drive of playback {self.playback}, {made_from}. {self.reason}."
        if self.refusal:
            return f"{head}\nNo drive could be made with the settings in use: {self.refusal}"
        drives = [
            (
                *(use.channel, f"{use.peak:.4g}", f"{100 * use.range_share:.0f} %", f"{use.slew:.4g}"),
                *(f"{100 * use.slew_share:.0f} %" if use.slew_share else "–", f"{100 * use.change:.0f} %"),
            )
            for use in self.drives
        ]
        responses = [
            (
                *(each.channel, f"{each.relative_rms_error:.3f}", f"{each.peak_ratio:.3f}"),
                *(*(f"{ratio:.3g}" for ratio in each.damage_ratio), _known(each.uncertainty)),
            )
            for each in self.responses
        ]
        return "\n".join(
            (
                head,
                f"Predicted error over all controlled responses: {self.overall_error:.3f}, at {100 * self.level:.0f} "
                "% of the target.",
                text_table(("drive", "peak", "of its range", "slew", "of its limit", "change"), drives, left=1),
                text_table(("response", "error", "peak", "damage k=3", "k=5", "k=8", "uncertainty"), responses, left=1),
                *self.remarks,
            )
        )


def _known(value: float) -> str:
    return "unknown" if np.isnan(value) else f"± {value:.3f}"


@dataclass(frozen=True)
class Decided:
    """Recorded decision at a hold point.

    Parameters
    ----------
    playback, proposal : int
        Numbers of the following playback and of the proposal.
    kind : DecisionKind
        Kind of the decision: play, change, back or end.
    name, reason : str
        Name of the person who decided, and the reason.
    when : datetime
        Time of the decision, UTC.
    from_iteration : int
        For `back`: playback from which the next drive is made.
    changes : tuple of str
        For `change`: the given sections, of update and control_band.
    """

    playback: int
    proposal: int
    kind: DecisionKind
    name: str
    reason: str
    when: datetime
    from_iteration: int = 0
    changes: tuple[str, ...] = ()

    @classmethod
    def from_message(cls, message: iterator_pb2.Decision) -> Decided:
        """Decode a decision."""
        prefix = "DECISION_KIND_"
        return cls(
            playback=message.playback,
            proposal=message.proposal,
            kind=DecisionKind[iterator_pb2.DecisionKind.Name(message.kind).removeprefix(prefix)],
            name=message.name,
            reason=message.reason,
            when=datetime.fromtimestamp(message.decided / _NANOSECONDS, UTC),
            from_iteration=message.from_iteration,
            changes=tuple(name for name in ("update", "control_band") if message.HasField(name)),
        )
