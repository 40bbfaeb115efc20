"""Corrections of the model from the playbacks of earlier campaigns, before the first playback."""

from __future__ import annotations

from dataclasses import replace

from duralab_settings import UpdateKind
from iterator.model import IterationHistory, Playback, RigModel
from iterator.updates.adaptive_modelling import corrected, estimate_correction
from iterator.updates.settings import UpdateSettings


def learned_before(earlier: tuple[tuple[Playback, ...], ...], model: RigModel, settings: UpdateSettings) -> RigModel:
    """Return the model corrected by playbacks of earlier campaigns on the same rig.

    The secant update keeps their steps and fits its model to them at every fit; Adaptive Modelling corrects the model
    by one playback after the other; basic TWR and plug-ins learn nothing.

    `earlier`: Drives mapped if there is a map, responses in the control band, by campaigns. `model`: As identified.
    """
    if settings.plugin is not None:
        return model
    if settings.kind is UpdateKind.SECANT:
        return replace(model, earlier=earlier)
    if settings.kind is UpdateKind.ADAPTIVE_MODELLING:
        for playback in (each for campaign in earlier for each in campaign):
            # The target of that campaign is near its response, and only shows which lines have energy.
            history = IterationHistory(target=playback.response, playbacks=(playback,))
            model = corrected(model, estimate_correction(history, model, settings), settings.prediction)
    return model
