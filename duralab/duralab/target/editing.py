"""Editing of a target, step by step, with a record of each step's effect."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from duralab.campaign import (
    Despike,
    EditSettings,
    EditStep,
    Filter,
    Join,
    RemoveDrift,
    RemoveMean,
    Resample,
    ShortenByDamage,
    Stretch,
    Taper,
    TaperLevel,
)
from duralab.data import Signals, StepRecord, step_record
from duralab.errors import InputError
from duralab_settings import dump_yaml


@dataclass(frozen=True, eq=False)
class EditedTarget:
    """Edited target, with the records of its steps.

    Parameters
    ----------
    signals : Signals
        Signals after the last step.
    records : tuple of StepRecord
        Records of the steps, in order; for a target from a file the first record describes the reading.
    """

    signals: Signals
    records: tuple[StepRecord, ...] = ()


@dataclass(frozen=True, eq=False)
class _Edited:
    """Result and findings of one step; findings are empty for a step that computes none."""

    signals: Signals
    spikes: Mapping[str, int] = field(default_factory=dict)
    damage_kept: Mapping[str, float] = field(default_factory=dict)
    sections: tuple[tuple[float, float], ...] = ()


def edit_signals(signals: Signals, steps: Sequence[EditStep | Mapping[str, Any] | str]) -> EditedTarget:
    """Apply the steps of a target editor in order.

    Parameters
    ----------
    signals : Signals
        Signals with finite samples.
    steps : sequence of EditStep, mapping or str
        Steps as under `target.edit` of a campaign file, e.g. `{"cut": {"from": 10, "to": 60}}` or "remove_mean".

    Returns
    -------
    EditedTarget
        Edited target; the given signals are unchanged.

    Raises
    ------
    InputError
        A step is unknown or does not fit the signals; the error names the key in the campaign file.
    """
    from duralab.campaign import checked_steps

    records = []
    for position, step in enumerate(checked_steps(steps)):
        place = f"target.edit.{position}.{step.name}"
        if not np.isfinite(signals.samples).all():
            raise InputError(f"{place}: the samples to edit are not all finite; repair the file.", field=place)
        try:
            edited = _APPLY[type(step.settings)](signals, step.settings)
        except ValueError as error:
            raise InputError(f"{place}: {error}", field=place) from error
        described = step.settings.model_dump(mode="json", by_alias=True, exclude_none=True)
        if described.get("channels") == []:
            del described["channels"]
        records.append(
            step_record(
                name=step.name,
                settings=dump_yaml(described, flow=True, width=10_000).strip(),
                before=signals,
                after=edited.signals,
                spikes=edited.spikes,
                damage_kept=edited.damage_kept,
                sections=edited.sections,
            )
        )
        signals = edited.signals
    return EditedTarget(signals, tuple(records))


def _samples(seconds: float, signals: Signals) -> int:
    return round(seconds * signals.sample_rate)


def _range(stretch: Stretch, signals: Signals) -> tuple[int, int]:
    """Return the first sample of a part, and the one after its last."""
    total = signals.samples.shape[1]
    end = signals.duration if stretch.end is None else stretch.end
    first, last = _samples(stretch.start, signals), _samples(end, signals)
    if last > total or first >= last:
        raise ValueError(
            f"The stretch goes from {stretch.start:g} to {end:g} s; it must lie within the target, which lasts "
            f"{signals.duration:g} s here, and hold a sample."
        )
    return first, last


def _seconds(sections: Sequence[tuple[int, int]], signals: Signals) -> tuple[tuple[float, float], ...]:
    return tuple((start / signals.sample_rate, end / signals.sample_rate) for start, end in sections)


def _rows(names: Collection[str], signals: Signals) -> list[int]:
    """Return the rows of the named channels; all rows without names."""
    unknown = [name for name in names if name not in signals.names]
    if unknown:
        raise ValueError(f"There is no channel {', '.join(unknown)} in the target; it has {', '.join(signals.names)}.")
    return [row for row, name in enumerate(signals.names) if not names or name in names]


def _on_rows(signals: Signals, names: Collection[str], change: Callable[[np.ndarray], np.ndarray]) -> Signals:
    rows = _rows(names, signals)
    samples = signals.samples.copy()
    samples[rows] = change(signals.samples[rows])
    return replace(signals, samples=samples)


def _cut(signals: Signals, settings: Stretch) -> _Edited:
    start, end = _range(settings, signals)
    samples = np.ascontiguousarray(signals.samples[:, start:end])
    return _Edited(replace(signals, samples=samples), sections=_seconds([(start, end)], signals))


def _remove_mean(signals: Signals, settings: RemoveMean) -> _Edited:
    from duralab_loads import remove_mean

    return _Edited(_on_rows(signals, settings.channels, remove_mean))


def _remove_drift(signals: Signals, settings: RemoveDrift) -> _Edited:
    from duralab_loads import remove_drift

    return _Edited(_on_rows(signals, settings.channels, lambda rows: remove_drift(rows, order=settings.order)))


def _filter(signals: Signals, settings: Filter) -> _Edited:
    from duralab_loads import FilterKind, filter_zero_phase

    name, corners = settings.kind

    def change(rows: np.ndarray) -> np.ndarray:
        return filter_zero_phase(
            rows, sample_rate=signals.sample_rate, kind=FilterKind(name), corners=corners, order=settings.order
        )

    return _Edited(_on_rows(signals, settings.channels, change))


def _resample(signals: Signals, settings: Resample) -> _Edited:
    from duralab_loads import resample

    samples = resample(signals.samples, sample_rate=signals.sample_rate, new_rate=settings.rate)
    return _Edited(replace(signals, samples=samples, sample_rate=settings.rate))


def _despike(signals: Signals, settings: Despike) -> _Edited:
    from duralab_loads import remove_spikes

    rows = _rows(settings.channels, signals)
    found = remove_spikes(
        signals.samples[rows], longest=max(1, _samples(settings.longest, signals)), threshold=settings.threshold
    )
    samples = signals.samples.copy()
    samples[rows] = found.samples
    spikes = {signals.names[row]: count for row, count in zip(rows, found.spikes, strict=True)}
    return _Edited(replace(signals, samples=samples), spikes=spikes)


def _taper(signals: Signals, settings: Taper) -> _Edited:
    from duralab_loads import taper_ends

    levels = signals.samples.mean(axis=1) if settings.to is TaperLevel.MEAN else 0.0
    samples = taper_ends(signals.samples, fade_samples=_samples(settings.seconds, signals), levels=levels)
    return _Edited(replace(signals, samples=samples))


def _join(signals: Signals, settings: Join) -> _Edited:
    from duralab_loads import join_sections

    sections = [section for segment in settings.segments for section in [_range(segment, signals)] * segment.repeat]
    samples = join_sections(signals.samples, sections, fade_samples=_samples(settings.cross_fade, signals))
    return _Edited(replace(signals, samples=samples), sections=_seconds(sections, signals))


def _shorten_by_damage(signals: Signals, settings: ShortenByDamage) -> _Edited:
    from duralab_loads import shorten_by_damage

    short = shorten_by_damage(
        signals.samples,
        keep=settings.keep,
        exponent=settings.exponent,
        window_samples=max(1, _samples(settings.window, signals)),
        fade_samples=_samples(settings.cross_fade, signals),
    )
    kept = {name: float(share) for name, share in zip(signals.names, short.kept, strict=True) if np.isfinite(share)}
    return _Edited(
        replace(signals, samples=short.samples), damage_kept=kept, sections=_seconds(short.sections, signals)
    )


_APPLY: Mapping[type[EditSettings], Callable[[Signals, Any], _Edited]] = {
    Stretch: _cut,
    RemoveMean: _remove_mean,
    RemoveDrift: _remove_drift,
    Filter: _filter,
    Resample: _resample,
    Despike: _despike,
    Taper: _taper,
    Join: _join,
    ShortenByDamage: _shorten_by_damage,
}
