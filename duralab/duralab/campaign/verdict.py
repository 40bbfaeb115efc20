"""Verdict whether the target was reached, shared by the report, the command line and lab scripts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from duralab.data import DAMAGE_SLOPES, IterationTable, passes
from duralab.errors import ended
from duralab_proto.v1 import iterator_pb2
from duralab_settings import Acceptance, SettingsError, YamlError, parse_yaml
from duralab_settings.messages import from_message

_ENDS: Final = MappingProxyType(
    {
        iterator_pb2.OUTCOME_REACHED: " It ended because its stop criteria were met.",
        iterator_pb2.OUTCOME_ITERATIONS_USED: " It ended because all playbacks were used.",
        iterator_pb2.OUTCOME_NO_IMPROVEMENT: " It ended because the last playbacks did not improve the best error.",
        iterator_pb2.OUTCOME_DAMAGE_BUDGET_USED: " It ended because the specimen's damage budget was used.",
        iterator_pb2.OUTCOME_ENDED_AT_HOLD_POINT: " It ended because a person decided so at a hold point.",
    }
)

_ALL_USED: Final = " The campaign used all planned iterations."
"""Replaces "all playbacks were used", which sounds like a failure after a reached target."""

_MOST_DECIMALS: Final = 6


class Judgement(StrEnum):
    """Verdict on an ended campaign."""

    REACHED = "reached"
    NOT_REACHED = "not reached"
    DIVERGED = "diverged"
    ENDED_EARLY = "ended early"


class Criterion(StrEnum):
    """Criteria of a result, named as in the section `accept` of a campaign file."""

    ERROR = "relative_rms_error"
    PEAK = "peak_ratio"
    DAMAGE = "damage_ratio"
    OUTSIDE = "energy_outside_band"


@dataclass(frozen=True)
class Limits:
    """Limits of a result; a criterion with None is not judged.

    `relative_rms_error`: Largest relative RMS error of a controlled channel. `peak_ratio`, `damage_ratio`: Smallest and
    largest ratio of response to target. `damage_exponent`: Slope of the S-N line for the damage: 3, 5 or 8.
    `energy_outside_band`: Largest share of the target's energy outside the control band, 0 to 1.
    """

    relative_rms_error: float | None = 0.15
    peak_ratio: tuple[float, float] | None = (0.9, 1.1)
    damage_ratio: tuple[float, float] | None = (0.8, 1.25)
    damage_exponent: int = 5
    energy_outside_band: float | None = 0.1

    def bounds(self, criterion: Criterion) -> tuple[float, float] | None:
        """Return the smallest and largest accepted value of a criterion; None if it is not judged."""
        limit = getattr(self, criterion.value)
        return limit if limit is None or isinstance(limit, tuple) else (0.0, limit)

    def name(self, criterion: Criterion) -> str:
        """Return the name of a criterion in a sentence."""
        return {
            Criterion.ERROR: "relative RMS error",
            Criterion.PEAK: "peak",
            Criterion.DAMAGE: f"damage at k = {self.damage_exponent}",
            Criterion.OUTSIDE: "energy outside the control band",
        }[criterion]

    def allowed(self, criterion: Criterion) -> str:
        """Return the limits of a criterion as text, e.g. "0.8 to 1.25" or "up to 5 %"."""
        bounds = self.bounds(criterion)
        if bounds is None:
            return "any"
        if criterion is Criterion.OUTSIDE:
            return f"up to {100 * bounds[1]:g} %"
        return f"up to {bounds[1]:g}" if criterion is Criterion.ERROR else f"{bounds[0]:g} to {bounds[1]:g}"


@dataclass(frozen=True)
class Finding:
    """Value of a criterion for one controlled channel of the best playback, with its limits.

    `criterion`: Criterion. `channel`: Name of the response. `value`: Its value. `smallest`, `largest`: Limits.
    """

    criterion: Criterion
    channel: str
    value: float
    smallest: float
    largest: float

    @property
    def accepted(self) -> bool:
        """Whether the value is within its limits."""
        return self.smallest <= self.value <= self.largest

    @property
    def badness(self) -> float:
        """Deviation, to find the worst value of a criterion; ratios above and below 1 count equally."""
        if self.criterion in (Criterion.ERROR, Criterion.OUTSIDE):
            return self.value
        return abs(np.log(self.value)) if self.value > 0.0 else np.inf

    def __str__(self) -> str:
        """Return the value as text, with enough decimals that rounding does not move it across a limit."""
        factor, unit = (100.0, " %") if self.criterion is Criterion.OUTSIDE else (1.0, "")
        fewest = {Criterion.OUTSIDE: 1, Criterion.DAMAGE: 2}.get(self.criterion, 3)
        for decimals in range(fewest, _MOST_DECIMALS):
            text = f"{factor * self.value:.{decimals}f}"
            if (self.smallest <= float(text) / factor <= self.largest) == self.accepted:
                return text + unit
        return f"{factor * self.value:.{_MOST_DECIMALS}f}{unit}"


@dataclass(frozen=True)
class Verdict:
    """Verdict on a campaign and its reason.

    Parameters
    ----------
    judgement : Judgement
        Judgement.
    sentence : str
        Summary of the verdict, with the numbers.
    limits : Limits
        Limits for the best playback.
    findings : tuple of Finding
        Judged values of the best playback; empty if no playback can be judged.
    """

    judgement: Judgement
    sentence: str
    limits: Limits
    findings: tuple[Finding, ...] = ()

    @property
    def failed(self) -> tuple[Finding, ...]:
        """Findings outside their limits."""
        return tuple(finding for finding in self.findings if not finding.accepted)

    def of(self, channel: str, criterion: Criterion) -> Finding | None:
        """Return the finding of one criterion for a channel.

        Parameters
        ----------
        channel : str
            Name of the response.
        criterion : Criterion
            Criterion.

        Returns
        -------
        Finding or None
            None if it is not judged: the channel is only monitored, its limit is null, or the value is unknown.
        """
        return next((f for f in self.findings if f.channel == channel and f.criterion is criterion), None)


def limits_of(specification: iterator_pb2.CampaignSpec, table: IterationTable) -> tuple[Limits, str]:
    """Return the limits of a campaign, and a note on their source if it is not the specification."""
    defaults = "it is judged by the defaults of this version of Duralab"
    if specification.HasField("accept"):
        try:
            accept, note = from_message(specification.accept, Acceptance, field="accept"), ""
        except SettingsError as error:
            accept = Acceptance()
            note = f"The limits to judge by in the recording are not allowed ({str(error).rstrip('.')}); {defaults}."
    else:
        found, note = _acceptance_in_text(specification, defaults=defaults)
        if found is None and np.isnan(table.energy_outside_band).all() and specification.stop.relative_rms_error > 0.0:
            accept = Acceptance(relative_rms_error=specification.stop.relative_rms_error)
            note += ", and by the error at which it was to end."
        elif found is None:
            accept = Acceptance()
            note += "."
        else:
            accept = found
    return _limits(
        relative_rms_error=accept.relative_rms_error,
        peak_ratio=accept.peak_ratio,
        damage_ratio=accept.damage_ratio,
        damage_exponent=accept.damage_exponent or specification.stop.damage_exponent,
        energy_outside_band=accept.energy_outside_band,
    ), note


def _limits(*, damage_exponent: float, **limits: Any) -> Limits:
    known = int(damage_exponent) if damage_exponent in DAMAGE_SLOPES else Limits.damage_exponent
    return Limits(damage_exponent=known, **limits)


def _acceptance_in_text(specification: iterator_pb2.CampaignSpec, *, defaults: str) -> tuple[Acceptance | None, str]:
    """Return the section `accept` of a recorded campaign file, and a sentence about the source of the limits.

    Without such a section the sentence has no full stop yet.
    """
    from duralab.campaign.loading import explained

    if not specification.scenario:
        return None, f"The recording holds no limits to judge by, and no campaign file; {defaults}"
    try:
        content = parse_yaml(specification.scenario)
        section = content.get("accept") if isinstance(content, dict) else None
        if section is None:
            return None, f"The recording holds no limits to judge by, nor does its campaign file; {defaults}"
        found = Acceptance.model_validate(section)
    except YamlError as error:
        reason = str(error)
    except ValidationError as error:
        reason = explained(error, place=("accept",)).message
    else:
        return found, "The limits to judge by were taken from the text of the campaign file in the recording."
    return None, (
        "The limits to judge by could not be taken from the text of the campaign file in the recording "
        f"({reason.rstrip('.')}); {defaults}"
    )


def judge(
    table: IterationTable,
    *,
    specification: iterator_pb2.CampaignSpec,
    status: iterator_pb2.CampaignStatus | None,
    open_end: str = "",
) -> Verdict:
    """Judge a campaign by its best playback.

    `table`: Numbers of its playbacks; `table.best` is judged. `specification`: Its specification; see `limits_of`.
    `status`: Status at its end; None if it did not end. `open_end`: Reason, as text, why its recording may continue
    elsewhere; empty if it does not.
    Returns: Judgement, its sentence, and the values with their limits.
    """
    limits, note = limits_of(specification, table)
    verdict = _judged(table, limits, status=status, open_end=open_end)
    return replace(verdict, sentence=f"{verdict.sentence} {note}") if note else verdict


def _judged(
    table: IterationTable, limits: Limits, *, status: iterator_pb2.CampaignStatus | None, open_end: str
) -> Verdict:
    whole = len(table) > 0 and table.level[table.best] == 1.0
    findings = _findings(table, limits) if whole else ()
    if status is None or status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED or not len(table):
        fault = status.fault.message if status is not None and status.HasField("fault") else ""
        reason = fault or open_end or "the recording ends before the campaign does."
        done = f"{len(table)} playback{'' if len(table) == 1 else 's'} done"
        return Verdict(Judgement.ENDED_EARLY, f"The campaign ended early, {done}: {ended(reason)}", limits, findings)
    if status.outcome == iterator_pb2.OUTCOME_RESPONSE_STOOD_STILL:
        # No value is judged: the value from a dead sensor means nothing.
        return Verdict(
            Judgement.ENDED_EARLY,
            f"The campaign ended early: in playback {table.numbers[-1]} a controlled response stood still while its "
            "target moved; its sensor gave nothing, and a remark names it.",
            limits,
        )
    failed = [finding for finding in findings if not finding.accepted]
    best = f"playback {table.numbers[table.best]} (best of {len(table)})"
    if not whole:
        summary = f"after {best}, the whole target was not played; this was {table.level[table.best]:g} of it"
    elif failed:
        summary = f"after {best}, {_failures(failed, limits)}"
    else:
        summary = f"after {best}, every channel is within its limits: {_worst_of_each(findings, limits)}"
    summary += f".{_not_judged(table, limits) if whole else ''}"
    end = _ENDS.get(status.outcome, "")
    if status.outcome == iterator_pb2.OUTCOME_BOUND_PASSED:
        sentence = (
            f"The campaign ended early: playback {table.numbers[-1]} passed a bound of error, peak or damage, which a "
            f"remark names. {summary[0].upper()}{summary[1:]}"
        )
        return Verdict(Judgement.ENDED_EARLY, sentence, limits, findings)
    if status.outcome == iterator_pb2.OUTCOME_DIVERGED:
        worst = int(np.argmax(table.judged_error[-1]))
        sentence = (
            f"The iteration diverged: in playback {table.numbers[-1]} the largest relative RMS error is "
            f"{table.judged_error[-1, worst]:.3f} ({_words(table.judged[worst])}). {summary[0].upper()}{summary[1:]}"
        )
        return Verdict(Judgement.DIVERGED, sentence, limits, findings)
    if failed or not whole:
        return Verdict(Judgement.NOT_REACHED, f"The target was not reached: {summary}{end}", limits, findings)
    if status.outcome == iterator_pb2.OUTCOME_ITERATIONS_USED:
        end = _ALL_USED
    return Verdict(Judgement.REACHED, f"The target was reached: {summary}{end}", limits, findings)


def _figures(table: IterationTable, limits: Limits) -> dict[Criterion, np.ndarray]:
    """Return the values of the best playback by criterion, shape (channels) each."""
    best = table.best
    return {
        Criterion.ERROR: table.relative_rms_error[best],
        Criterion.PEAK: table.peak_ratio[best],
        Criterion.DAMAGE: table.damage_ratio[best, :, DAMAGE_SLOPES.index(limits.damage_exponent)],
        Criterion.OUTSIDE: table.energy_outside_band,
    }


def _findings(table: IterationTable, limits: Limits) -> tuple[Finding, ...]:
    return tuple(
        Finding(criterion, channel, float(value), *bounds)
        for criterion, values in _figures(table, limits).items()
        if (bounds := limits.bounds(criterion)) is not None
        for channel, value, watched in zip(table.channels, values, table.watched, strict=True)
        if not watched and not np.isnan(value)
    )


def _failures(failed: list[Finding], limits: Limits) -> str:
    """Return the channels and the worst value of each failed criterion, as text."""
    parts = []
    for criterion in Criterion:
        found = [finding for finding in failed if finding.criterion is criterion]
        if not found:
            continue
        worst = max(found, key=lambda finding: finding.badness)
        names = [_words(finding.channel) for finding in found]
        where = " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
        value = f"is {worst}" if len(names) == 1 else f"is {worst} at worst, in {_words(worst.channel)}"
        parts.append(f"{limits.name(criterion)} of {where} {value} (allowed {limits.allowed(criterion)})")
    return "; ".join(parts)


def _worst_of_each(findings: tuple[Finding, ...], limits: Limits) -> str:
    """Return the worst channel of each criterion with its limits, as text."""
    worst = {
        criterion: max((f for f in findings if f.criterion is criterion), key=lambda f: f.badness, default=None)
        for criterion in Criterion
    }
    return "; ".join(
        f"{limits.name(criterion)} {finding} at worst ({_words(finding.channel)}; allowed {limits.allowed(criterion)})"
        for criterion, finding in worst.items()
        if finding is not None
    )


def _not_judged(table: IterationTable, limits: Limits) -> str:
    """Return the criteria that are not judged, with the reasons, as text."""
    parts = []
    for criterion, values in _figures(table, limits).items():
        unknown = [
            name
            for name, value, watched in zip(table.channels, values, table.watched, strict=True)
            if np.isnan(value) and not watched
        ]
        if limits.bounds(criterion) is None:
            parts.append(f"{limits.name(criterion)} (accept.{criterion} is null)")
        elif unknown:
            of = "" if len(unknown) == len(table.judged) else f" of {', '.join(map(_words, unknown))}"
            parts.append(f"{limits.name(criterion)}{of} (the recording has no figure of it)")
    return f" Not judged: {'; '.join(parts)}." if parts else ""


def compare_with_first(table: IterationTable) -> str:
    """Compare the best playback with the first, channel by channel, as text.

    `table`: Numbers of one or more playbacks.
    Returns: One or more sentences.
    """
    if len(table) < 2:
        return "There was one playback only, so nothing to compare it with."
    if table.best == 0:
        return "No later playback is better than the first."
    worse = [
        _words(name)
        for name, first, best in zip(table.judged, table.judged_error[0], table.judged_error[table.best], strict=True)
        if best >= first
    ]
    if not worse:
        return "Every channel is closer to its target than after the first playback."
    return f"Not closer to the target than after the first playback: {', '.join(worse)}."


def repeatability_in_words(status: iterator_pb2.CampaignStatus) -> str:
    """Compare the error with the rig's repeatability in one sentence; empty if no drive was repeated.

    `status`: Status of an ended campaign.
    Returns: One sentence, or an empty string.
    """
    watched = {channel.channel for channel in status.iterations[-1].channels if channel.watched}
    reported = [channel for channel in status.repeatability.channels if channel.channel not in watched]
    if not reported:
        return ""
    repeated = f"{status.repeatability.playbacks} playbacks of the drive of playback {status.repeatability.iteration}"
    noisy = [channel for channel in reported if channel.noise_floor > 0.0]
    if not noisy:
        return f"The rig repeats {repeated} exactly."
    worst = max(noisy, key=lambda channel: channel.relative_rms_error / channel.noise_floor)
    error, floor = worst.relative_rms_error, worst.noise_floor
    return (
        f"By {repeated}, the target is reproduced to within {error / floor:.1f} × of the repeatability; the largest is "
        f"that of {_words(worst.channel)}, {error:.3f} over a noise floor of {floor:.2g}."
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def judged_rows(
    table: IterationTable, verdict: Verdict, *, slope: int
) -> tuple[list[tuple[str, str]], list[list[str]]]:
    """Return the judged values of the best playback, with ✗ at those outside their limits.

    The heading of each column is its name and its limits or unit.

    `table`: Numbers of one or more playbacks. `verdict`: Verdict on the best of them. `slope`: Slope of the S-N line
    for the damage spent.
    Returns: Headings of the columns, each with its limits or unit, and a row of cells for each channel.
    """
    limits, spent = verdict.limits, table.damage_spent(slope)[-1]
    judged = [criterion for criterion in Criterion if limits.bounds(criterion) is not None]
    names = {
        Criterion.ERROR: "error",
        Criterion.DAMAGE: f"damage, k = {limits.damage_exponent}",
        Criterion.OUTSIDE: "energy outside band",
    }
    header = [(names.get(criterion, limits.name(criterion)), limits.allowed(criterion)) for criterion in judged]
    rows = []
    for i, channel in enumerate(table.channels):
        findings = [verdict.of(channel, criterion) for criterion in judged]
        cells = ["–" if found is None else f"{found}{'' if found.accepted else ' ✗'}" for found in findings]
        mark = " (monitored)" if table.watched[i] else ""
        rows.append([f"{channel.replace('_', ' ')}{mark}", *cells, passes(spent[i])])
    return [("channel", ""), *header, ("damage spent", f"passes, k = {slope}")], rows
