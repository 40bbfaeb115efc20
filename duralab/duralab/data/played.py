"""Response of a rig to a single playback."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

from duralab.data.playback import USE_COLUMNS, ActuatorUse, use_rows
from duralab.data.signals import Signals, signals_html, signals_text
from duralab.display import html_table, text_table


@dataclass(frozen=True, eq=False)
class Played:
    """Response of a rig to a drive.

    Parameters
    ----------
    run : str
        Name of the playback.
    response : Signals
        All responses, with the drive's number of samples.
    actuators : tuple of ActuatorUse
        Use of each actuator.
    real_time_factor : float
        Simulated seconds per second of wall time.
    warnings : tuple of str
        Responses that exceeded the warning level of their sensor, one sentence each.
    """

    run: str
    response: Signals
    actuators: tuple[ActuatorUse, ...]
    real_time_factor: float
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return a one-line description without arrays."""
        return f"Played({self.run}: {self.response!r})"

    def __str__(self) -> str:
        """Return a table as text."""
        return played_text(self)

    def _repr_html_(self) -> str:

        return played_html(self)


def _played_title(played: Played) -> str:
    return f"{played.run}, {played.real_time_factor:.0f} times as fast as real time"


def played_text(played: Played) -> str:
    """Return responses and use of the actuators as text."""
    use = text_table(USE_COLUMNS, use_rows(played.actuators), left=1)
    return "\n".join([f"{_played_title(played)}\n{signals_text(played.response)}\n\n{use}", *played.warnings])


def played_html(played: Played) -> str:
    """Return the same as HTML, with the waveforms."""
    use = html_table(USE_COLUMNS, use_rows(played.actuators), left=1)
    warnings = "".join(f"<p>{escape(sentence)}</p>" for sentence in played.warnings)
    return f"<p>{escape(_played_title(played))}</p>{use}{warnings}{signals_html(played.response)}"
