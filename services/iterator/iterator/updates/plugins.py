"""Updates of installed distributions with the entry points `duralab.updates`."""

from __future__ import annotations

import json
from typing import Final, Protocol, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from duralab_settings import SettingsError, UpdateKind, UpdatePlugin, explained, load_plugin, one_line
from iterator.band import ControlBand
from iterator.model import IterationHistory, RigModel
from iterator.updates.settings import NextDrive, Update, UpdateSettings, own_update

GROUP: Final = "duralab.updates"
"""Entry point group of plug-ins: each names a pydantic model of its settings with a method `next_drive`."""

LARGEST_SHARE_ABOVE: Final = 0.02
"""Largest RMS of a drive above the control band's upper flank, relative to the whole: rounding and fades."""

# Share of a record that is faded before its spectrum is judged, as a drive is faded before it is played.
_TAPER: Final = 0.05


class _UpdateModel(Protocol):
    """Interface of the settings model of a plug-in."""

    def next_drive(self, history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
        """Return the next drive."""
        ...


def plugin_update(plugin: UpdatePlugin) -> tuple[Update, str]:
    """Return the update of a plug-in with its settings, and a sentence that names it as the source of the drives.

    Raises `SettingsError`: No plug-in or several have the name, the import fails, the entry point is not a model with
    `next_drive`, or the settings are not allowed. The update itself raises ValueError if the plug-in raises any error,
    or returns a drive that cannot be played.
    """
    found = load_plugin(GROUP, plugin.name, field="update.plugin.name", shipped=[kind.value for kind in UpdateKind])
    name = f"the update plug-in {found.name!r} of {found.source}"
    kind = found.content
    if not (isinstance(kind, type) and issubclass(kind, BaseModel) and callable(getattr(kind, "next_drive", None))):
        raise SettingsError(
            f"T{name[1:]} is {kind!r:.80}; its entry point must name a pydantic model of its settings that has a "
            "method next_drive(history, model, settings).",
            field="update.plugin.name",
        )
    try:
        made = kind.model_validate(json.loads(plugin.settings))
    except ValidationError as error:
        raise explained(error, kind, prefix="update.plugin.settings") from error
    settings = ", ".join(f"{key} {value}" for key, value in made.model_dump(mode="json").items())
    checked = own_update(_guarded(cast(_UpdateModel, made), name), name=name)

    def update(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
        try:
            step = checked(history, model, settings)
        except TypeError as error:
            raise ValueError(str(error)) from error
        _require_in_band(step.drive, settings.band, name=name)
        return step

    return update, f"The drives are made by {name}{f' with {settings}' if settings else ''}."


def _guarded(made: _UpdateModel, name: str) -> Update:
    """Return the method of a plug-in with its name in all errors."""

    def next_drive(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
        try:
            return made.next_drive(history, model, settings)
        except Exception as error:
            raise ValueError(f"T{name[1:]} raised {one_line(error)}; correct it, then resume the campaign.") from error

    return next_drive


def _require_in_band(drive: NDArray[np.float64], band: ControlBand, *, name: str) -> None:
    """Refuse a drive with content above the band, where the model is not valid and the rig may be damaged."""
    # The import takes a second, and most campaigns have no plug-in.
    from scipy.signal.windows import tukey

    tapered = drive * tukey(drive.shape[1], _TAPER)
    energy = np.abs(np.fft.rfft(tapered, axis=1)) ** 2
    above = np.fft.rfftfreq(drive.shape[1], 1.0 / band.sample_rate) > band.highest_driven
    total = energy.sum(axis=1)
    share = np.sqrt(np.divide(energy[:, above].sum(axis=1), total, out=np.zeros_like(total), where=total > 0.0))
    worst = int(np.argmax(share))
    if share[worst] > LARGEST_SHARE_ABOVE:
        raise ValueError(
            f"T{name[1:]} returned a drive whose channel {worst + 1} has {100 * share[worst]:.0f} % of its RMS above "
            f"{band.highest_driven:g} Hz, the end of the control band; at most {100 * LARGEST_SHARE_ABOVE:.0f} % is "
            "played: limit its steps by apply_inverse or settings.band.limit_drive."
        )
