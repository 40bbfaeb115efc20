"""Playbacks that the next drive is made from: all, in order, unless a decision went back to an earlier one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from duralab_drive_map import DriveMap
from duralab_spectra import rms
from iterator.assessment import Forecast
from iterator.holds.basis import Basis
from iterator.limits import DriveLimits, held_share
from iterator.model import IterationHistory, Playback, RigModel
from iterator.playbacks import NOTHING_KNOWN, KnownBefore, mapped_drive
from iterator.updates import learned_before

# Share of the time at a limit above which the nonlinear terms of the last drive are not used: the square of a clipped
# drive does not predict its effect. With 85 % of the stroke that a target needs it is 0.6 to 1 %.
_MOST_HELD: Final = 0.002


@dataclass(frozen=True)
class Revision:
    """Changes of a decision before a drive is made again.

    `basis`: New basis of drives and judgements; None for no change. `from_iteration`: Playback that the next drive is
    made from; 0 for the last one.
    """

    basis: Basis | None = None
    from_iteration: int = 0


@dataclass(frozen=True, eq=False)
class _Made:
    """Data of a playback for a return to it, or for its judgement in another control band."""

    basis: Basis
    drive_map: DriveMap | None
    drive: NDArray[np.float64]
    response: NDArray[np.float64]
    level: float
    model: RigModel
    forecast: Forecast
    numbers: tuple[int, ...]
    """Numbers of the playbacks that lead to it, its own number last."""


class Lineage:
    """Data that the next drive is made from.

    `basis`: Basis of the campaign. `limits`: Drive limits of the rig, if known. `drive_map`: Map of the drives; None
    for the identity. `keep`: Whether decisions are possible: then the samples of every playback are kept. `known`:
    Knowledge before the first playback.
    """

    def __init__(
        self,
        basis: Basis,
        *,
        limits: DriveLimits | None,
        drive_map: DriveMap | None,
        keep: bool,
        known: KnownBefore = NOTHING_KNOWN,
    ) -> None:
        self.basis = basis
        self.drive_map = drive_map
        self._known = known
        self.history = IterationHistory(basis.controlled_target, self._before(), start=self._start())
        self.model = self._informed(basis.model)
        """Model that the last drive was made with, if the basis is still the same."""
        self.forecast: Forecast | None = None
        """Forecast of the last playback, compared with it; None before the first and if it is not comparable."""
        self.last_drive: NDArray[np.float64] | None = None
        self.numbers: tuple[int, ...] = ()
        """Numbers of the playbacks that the next drive is made from."""
        self._limits = limits
        self._keep = keep
        self._made: list[_Made] = []

    @property
    def is_held(self) -> bool:
        """Whether the last drive was at a limit for so long that its nonlinear terms are not used."""
        if self.last_drive is None or self._limits is None:
            return False
        return held_share(self.last_drive, self._limits) > _MOST_HELD

    def add(
        self,
        *,
        drive: NDArray[np.float64],
        mapped: NDArray[np.float64],
        response: NDArray[np.float64],
        judged: NDArray[np.float64],
        level: float,
        model: RigModel,
        forecast: Forecast,
        number: int,
        made_with: DriveMap | None,
    ) -> None:
        """Add a playback.

        `drive`, `mapped`, shape (n_u, samples): As played, and as mapped for updates. `response`, shape (n_y,
        samples): As measured. `judged`: Rows of the controlled responses in the band, divided by the level. `model`:
        Model of the drive. `forecast`: Forecast, compared with the playback. `made_with`: The drive map, if any.
        """
        self.model = model
        if self._informed_with is not self.drive_map:
            # A drive map that was learned from this playback also maps the drives of earlier ones.
            before = self._before()
            self.history = replace(self.history, playbacks=(*before, *self.history.playbacks[len(before) :]))
            informed = self._informed(self.basis.model)
            self.model = informed if self._known.campaigns else model
        self.history = self.history.after(Playback(drive=mapped / level, response=judged))
        self.forecast, self.last_drive = forecast, drive
        self.numbers = (*self.numbers, number)
        if self._keep:
            self._made.append(
                _Made(self.basis, made_with, drive, response, level, model, forecast, numbers=self.numbers)
            )

    def revise(self, revision: Revision) -> None:
        """Go back to an earlier playback, change the basis of drives and judgements, or both."""
        if revision.from_iteration:
            self.numbers = self._made[revision.from_iteration - 1].numbers
        self.basis = basis = revision.basis or self.basis
        line = [self._made[number - 1] for number in self.numbers]
        playbacks = (*self._before(), *(self._seen(made) for made in line))
        self.history = IterationHistory(basis.controlled_target, playbacks, start=self._start())
        last = line[-1] if line else None
        self.last_drive = None if last is None else last.drive
        # The corrections of an update are kept if it continues from there; otherwise it learns again.
        self.model = last.model if last is not None and basis.updates_as(last.basis) else self._informed(basis.model)
        self.forecast = last.forecast if last is not None and basis.judges_as(last.basis) else None

    def given_drive(self) -> NDArray[np.float64] | None:
        """Return the first drive that is played unchanged, mapped and in the band; None if there is none."""
        first = self._known.first_drive
        return None if first is None or first.response is not None else self._in_band(first.drive)

    def _before(self) -> tuple[Playback, ...]:
        """Return the playback of a first drive that was already made for this target, if any."""
        first = self._known.first_drive
        if first is None or first.response is None or not first.of_this_target:
            return ()
        return (Playback(self._in_band(first.drive), self._response(first.response)),)

    def _start(self) -> Playback | None:
        """Return the first drive with its response, both scaled to the target."""
        first = self._known.first_drive
        if first is None or first.response is None or first.of_this_target:
            return None
        target, response = self.basis.controlled_target, self._response(first.response)
        weight = 1.0 / np.square(rms(target))
        energy = float(weight @ np.einsum("ct,ct->c", response, response))
        scale = float(weight @ np.einsum("ct,ct->c", response, target)) / energy if energy > 0.0 else 0.0
        return Playback(drive=scale * self._in_band(first.drive), response=scale * response)

    def _informed(self, model: RigModel) -> RigModel:
        """Return a model corrected by the playbacks of earlier campaigns."""
        self._informed_with = self.drive_map
        earlier = tuple(
            tuple(Playback(self._in_band(each.drive), self._response(each.response)) for each in campaign)
            for campaign in self._known.campaigns
        )
        return learned_before(earlier, model, self.basis.own_settings.update) if earlier else model

    def _in_band(self, drive: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.basis.settings.update.band.limit_drive(mapped_drive(drive, self.drive_map))

    def _response(self, response: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.basis.rows(self.basis.settings.update.band.limit_response(response))

    def _seen(self, made: _Made) -> Playback:
        """Return a playback as the update uses it now: in this control band, mapped by this map."""
        band = self.basis.settings.update.band
        fits = made.basis.settings.update.band == band and made.drive_map is self.drive_map
        mapped = mapped_drive(made.drive, self.drive_map)
        response = self.basis.rows(band.limit_response(made.response) / made.level)
        # Parts of a drive outside the band would stay in every later drive.
        return Playback(drive=(mapped if fits else band.limit_drive(mapped)) / made.level, response=response)
