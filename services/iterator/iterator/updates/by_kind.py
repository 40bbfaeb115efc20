"""Updates that a campaign can name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from duralab_settings import UpdateKind
from iterator.updates import adaptive_modelling, basic_twr, secant_update
from iterator.updates.plugins import plugin_update
from iterator.updates.settings import Update, UpdateSettings

UPDATES: Final[Mapping[UpdateKind, Update]] = MappingProxyType(
    {
        UpdateKind.BASIC_TWR: basic_twr.next_drive,
        UpdateKind.ADAPTIVE_MODELLING: adaptive_modelling.next_drive,
        UpdateKind.SECANT: secant_update.next_drive,
    }
)
"""Update of each kind."""


def chosen_update(settings: UpdateSettings) -> Update:
    """Return the update of the settings: that of the plug-in, or that of the kind."""
    return UPDATES[settings.kind] if settings.plugin is None else plugin_update(settings.plugin)[0]
