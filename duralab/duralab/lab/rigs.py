"""The rigs of a lab as a script meets them: what they are, playing, identifying and stopping them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np

from duralab.arguments import progress_callback
from duralab.data import Model, Played, Rig, Rigs, RigState, Signals
from duralab.errors import InputError
from duralab.lab.client import Deadline, LabClient, deadline_of
from duralab.lab.identifier import Identifier
from duralab.lab.playing import halting, play_drive, reset_rig, state_of_rig, stop_rig
from duralab.lab.progress import OnProgress
from duralab_proto.v1 import rig_pb2
from duralab_settings import EstimatorSettings, ExcitationSettings

if TYPE_CHECKING:
    import xarray


class LabRigs:
    """The rigs of a lab; what every `Lab` can do with them.

    Parameters
    ----------
    ask : LabClient
        The lab.
    """

    def __init__(self, ask: LabClient) -> None:
        self._ask = ask

    def rig_names(self) -> list[str]:
        """Return the names of all rigs that are there; one that cannot be used says why when it is asked."""
        return sorted(instance for _, instance in self._ask.bus.live("rig_sim"))

    @property
    def identifier(self) -> Identifier:
        """Identifies rigs without a campaign around it."""
        return Identifier(
            query=self._ask.query,
            describe=self.describe,
            keys=self._ask.bus.keys,
            halting=lambda rig, deadline: halting(self._ask, rig, deadline),
        )

    def rigs(self) -> Rigs:
        """Return all rigs that are there, by name; raises `LabError` where one of them cannot be used."""
        return Rigs(self.describe(name) for name in self.rig_names())

    def describe(self, rig: str) -> Rig:
        """Return what a rig is and what it can play.

        Parameters
        ----------
        rig : str
            Its name.

        Returns
        -------
        Rig
            Channels, limits, sample rate.

        Raises
        ------
        InputError
            There is no such rig.
        """
        key = self._ask.key("rig", self._ask.bus.keys.rig_description, rig)
        known = self.rig_names()
        if rig not in known and self._ask.failure() is None:
            there = (
                f"there are {', '.join(known)}"
                if known
                else "no rig is on the bus, or not yet: see whether rig_sim runs"
            )
            raise InputError(f"There is no rig {rig!r}; {there}.", field="rig")
        return Rig.from_message(self._ask.query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription))

    def state(self, rig: str) -> RigState:
        """Return what a rig does now.

        Parameters
        ----------
        rig : str
            Its name.

        Returns
        -------
        RigState
            Whether it rests, plays or is latched, and why.

        Raises
        ------
        LabError
            It is not there.
        """
        return state_of_rig(self._ask, rig)

    def reset(self, rig: str) -> RigState:
        """Clear the latch of a rig, after somebody has looked at it; one that is not latched stays as it is.

        Parameters
        ----------
        rig : str
            Its name.

        Returns
        -------
        RigState
            After the reset.

        Raises
        ------
        LabError
            It is not there, does not come to rest, or was stopped again while the reset waited.
        """
        return reset_rig(self._ask, rig)

    def play(
        self,
        rig: str,
        drive: np.ndarray | xarray.DataArray | xarray.Dataset | Signals,
        *,
        run: str | None = None,
        seed: int = 0,
        real_time: bool = False,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> Played:
        """Play a drive on a rig and wait for its response.

        Parameters
        ----------
        rig : str
            Its name.
        drive : array, DataArray, Dataset or Signals, shape (drives, samples)
            A plain array in the units, the order and at the sample rate of the rig's description. Where channels have
            names, they may be in any order, and units and rate are checked; a name without a unit is refused.
        run : str, optional
            Name of the playback, unique on the rig; a new one where not given.
        seed : int
            Of what is random in a simulated rig, 0 to 2^63 - 1.
        real_time : bool
            Play no faster than real time.
        on_progress : callable, optional
            Called with a `RunProgress` about once a second.
        timeout_seconds : float, optional
            Longest time to wait; then the rig is stopped and latched. However long it takes, where not given.
        cancel : threading.Event, optional
            Set from another thread, it stops the rig and latches it.

        Returns
        -------
        Played
            The response, and how the actuators were used.

        Raises
        ------
        InputError
            There is no such rig, or it refused the drive.
        BusyError, NotReadyError
            It plays, or is latched.
        StoppedError, LabTimeoutError
            Somebody stopped it, or the time was over.
        LabError
            It met a limit, or is gone.
        """
        end = deadline_of(timeout_seconds, cancel)
        return self._play(
            rig, drive, run=run, seed=seed, real_time=real_time, tell=progress_callback(on_progress), end=end
        )

    def _play(
        self,
        rig: str,
        drive: np.ndarray | xarray.DataArray | xarray.Dataset | Signals,
        *,
        run: str | None,
        seed: int,
        tell: OnProgress,
        end: Deadline,
        real_time: bool = False,
    ) -> Played:
        described = self.describe(rig)
        return play_drive(self._ask, described, drive, run=run, seed=seed, real_time=real_time, tell=tell, deadline=end)

    def identify(
        self,
        rig: str,
        excitation: ExcitationSettings,
        estimator: EstimatorSettings,
        *,
        seed: int = 0,
        on_progress: OnProgress | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> Model:
        """Run an experiment on a rig and return the model; see `Identifier.identify`, and `identifier` for more."""
        return self.identifier.identify(
            rig,
            excitation,
            estimator,
            seed=seed,
            on_progress=on_progress,
            timeout_seconds=timeout_seconds,
            cancel=cancel,
        )

    def stop_rig(self, rig: str, *, reason: str = "") -> RigState:
        """Ramp a rig down and latch it, whatever it does; return when it rests.

        A rig whose run cannot be stopped answers at once: `goes_on` of the state is True, and the run goes on to its
        end.

        Parameters
        ----------
        rig : str
            Its name.
        reason : str
            In words; the rig tells it until it is reset.

        Returns
        -------
        RigState
            Latched, and at rest unless `goes_on`.

        Raises
        ------
        LabError
            It is not there, or does not come to rest.
        """
        return stop_rig(self._ask, rig, reason=reason)
