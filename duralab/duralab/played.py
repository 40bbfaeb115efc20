"""What came back from a rig that was played by hand."""

from __future__ import annotations

from dataclasses import dataclass

from duralab.recording_content import ActuatorUse
from duralab.signals import Signals


@dataclass(frozen=True, eq=False)
class Played:
    """What a rig answered to a drive.

    Parameters
    ----------
    run : str
        Name of the playback.
    response : Signals
        All responses, as many samples as the drive.
    actuators : tuple of ActuatorUse
        How each actuator was used.
    real_time_factor : float
        Simulated seconds per second of wall time.
    """

    run: str
    response: Signals
    actuators: tuple[ActuatorUse, ...]
    real_time_factor: float

    def __repr__(self) -> str:
        """Return it on one line, without arrays."""
        return f"Played({self.run}: {self.response!r})"

    def __str__(self) -> str:
        """Return it as a table."""
        from duralab.showing.values import played_text

        return played_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.values import played_html

        return played_html(self)
