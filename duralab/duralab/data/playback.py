"""Playbacks of a campaign and the actuator use."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np

from duralab.data.band import response_note
from duralab.data.recorded_signals import RecordedSignals
from duralab.data.signals import Signals, signals_html, signals_text
from duralab.display import html_table, text_table
from duralab_proto.v1 import iterator_pb2, rig_pb2

USE_COLUMNS: Final = ("actuator", "peak of its limit", "saturated", "largest following error")


@dataclass(frozen=True)
class ActuatorUse:
    """Use of one actuator in a playback; see `duralab.v1.ActuatorUse`.

    Parameters
    ----------
    drive : str
        Name of the drive.
    peak_command_ratio : float
        Largest magnitude of the drive over the limit in that direction, 0 to 1.
    saturated_share : float
        Share of the time with the valve at its stop or the load pressure at its limit, 0 to 1.
    largest_following_error : float
        Largest difference of command and achieved value, in the drive's unit.
    largest_load_pressure_share : float
        Largest load pressure over the pressure available from the supply at that moment, 0 to 1; 1 is a stall. Zero,
        as the next one, in recordings made before it was measured.
    lowest_supply_pressure : float
        Lowest pressure of the actuator's supply, in Pa.
    """

    drive: str
    peak_command_ratio: float
    saturated_share: float
    largest_following_error: float
    largest_load_pressure_share: float = 0.0
    lowest_supply_pressure: float = 0.0

    @property
    def tells_of_a_valve(self) -> bool:
        """Whether the rig reports a valve and a supply; a rig without them leaves these values at 0."""
        return any((self.saturated_share, self.largest_load_pressure_share, self.lowest_supply_pressure))

    @property
    def tells_what_was_achieved(self) -> bool:
        """Whether the rig reports the following error: with a real comparison it is never exactly 0."""
        return self.largest_following_error != 0.0


def actuator_use(messages: Iterable[rig_pb2.ActuatorUse]) -> tuple[ActuatorUse, ...]:
    """Decode the actuator use, in the order of the drives.

    `messages`: One message for each drive.
    Returns: Use of the actuators, in the same order.
    """
    return tuple(
        ActuatorUse(
            drive=message.drive,
            peak_command_ratio=message.peak_command_ratio,
            saturated_share=message.saturated_share,
            largest_following_error=message.largest_following_error,
            largest_load_pressure_share=message.largest_load_pressure_share,
            lowest_supply_pressure=message.lowest_supply_pressure,
        )
        for message in messages
    )


@dataclass(frozen=True, eq=False)
class Playback:
    """One playback of the target's drive.

    Parameters
    ----------
    number : int
        Number of the playback, from 1.
    run : str
        Name of its run on the rig.
    drive, response : Signals
        Played drive and measured response.
    response_in_band : Signals
        Response in the form used for judging: in the control band, without its static part, divided by `level`.
    actuators : tuple of ActuatorUse
        Use of the actuator of each drive.
    level : float
        Level as a share of the target, greater than 0, at most 1.
    """

    number: int
    run: str
    drive: Signals
    response: Signals
    response_in_band: Signals
    actuators: tuple[ActuatorUse, ...]
    level: float = 1.0

    def __repr__(self) -> str:
        """Return a one-line description without arrays."""
        return f"Playback({self.number}, {self.run}: {self.response!r})"

    def __str__(self) -> str:
        """Return a table as text."""
        return playback_text(self)

    def _repr_html_(self) -> str:

        return playback_html(self)


def level_of(step: iterator_pb2.IterationStep) -> float:
    """Return the level of a playback; older recordings do not contain it and are at 1.

    `step`: Recorded playback.
    Returns: Share of the target, greater than 0, at most 1.
    """
    return step.level or 1.0


def playback_of(
    step: iterator_pb2.IterationStep,
    specification: iterator_pb2.CampaignSpec,
    *,
    drive: Signals,
    response: Signals,
    in_band: np.ndarray,
) -> Playback:
    """Return a playback of a campaign.

    `step`: Recorded playback. `specification`: Specification of the campaign. `drive`, `response`: Samples of its run.
    `in_band`: Response in the form used for judging.
    Returns: The playback.
    """

    def noted(samples: np.ndarray, *, in_band: bool) -> RecordedSignals:
        note = response_note(specification, in_band=in_band)
        return RecordedSignals(response.channels, response.sample_rate, samples, note=note)

    return Playback(
        number=step.iteration,
        run=step.run,
        drive=drive,
        response=noted(response.samples, in_band=False),
        response_in_band=noted(in_band, in_band=True),
        actuators=actuator_use(step.actuators),
        level=level_of(step),
    )


def use_rows(uses: Sequence[ActuatorUse]) -> list[tuple[str, ...]]:
    """Return a row of cells for each actuator, with the columns of `USE_COLUMNS`."""
    return [
        (
            use.drive,
            f"{100 * use.peak_command_ratio:.0f} %",
            f"{100 * use.saturated_share:.2f} % of the time" if use.tells_of_a_valve else "–",
            f"{use.largest_following_error:.3g}" if use.tells_what_was_achieved else "–",
        )
        for use in uses
    ]


def playback_text(playback: Playback) -> str:
    """Return one playback of a campaign as text."""
    use = text_table(USE_COLUMNS, use_rows(playback.actuators), left=1)
    return f"playback {playback.number}, {playback.run}\n{signals_text(playback.response)}\n\n{use}"


def playback_html(playback: Playback) -> str:
    """Return the same as HTML, with the waveforms."""
    use = html_table(USE_COLUMNS, use_rows(playback.actuators), left=1)
    title = f"<p>playback {playback.number}, {escape(playback.run)}</p>"
    return f"{title}{use}{signals_html(playback.response)}"
