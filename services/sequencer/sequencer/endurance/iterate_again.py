"""Correction of an event's drive: a separate campaign on the iterator, from the present drive and a known model."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final, Protocol

import numpy as np
from google.protobuf.message import Message
from numpy.typing import ArrayLike, NDArray

from duralab_bus import Bus, FaultError, message_of_step, recorded_steps
from duralab_monitoring import Alarm, Measure, Statistic
from duralab_proto.arrays import ArrayError, from_array, from_record, to_record
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2
from duralab_settings import ResolvedUpdate
from duralab_settings.messages import fill_message, from_message

AWAY: Final = frozenset({query_pb2.FAULT_CODE_UNAVAILABLE, query_pb2.FAULT_CODE_DEADLINE_EXCEEDED})
"""Fault codes of a query to a recorder that is absent."""

_POLL_SECONDS: Final = 0.5
_SILENCE_SECONDS: Final = 10.0
# Chosen on three kinds of wear and four roads, see decisions 41 and 50.
_FORGETTING: Final = 0.5
_PRIOR_STRENGTH: Final = 0.1
_GAIN: Final = 0.9
_ENDED: Final = (
    iterator_pb2.CAMPAIGN_PHASE_FINISHED,
    iterator_pb2.CAMPAIGN_PHASE_FAULTED,
    iterator_pb2.CAMPAIGN_PHASE_STOPPED,
)
# Measures that a campaign reproduces with a control band from 0 Hz only.
_STATIC: Final = frozenset({Measure.STATIC, Statistic.MEAN})
# A shift of the static part changes these, too.
_WITH_MEAN: Final = frozenset({Statistic.MIN, Statistic.MAX, Statistic.RMS})
_KINDS: Final = {
    kind.DESCRIPTOR.full_name: kind
    for kind in (
        iterator_pb2.CampaignSpec,
        identifier_pb2.Model,
        iterator_pb2.IterationStep,
        recorder_pb2.RunPlanned,
    )
}


class PassedLimit(Protocol):
    """Function that returns the abort limit passed by a response, farther than by the present one; empty if none."""

    def __call__(self, response: ArrayLike, *, present: ArrayLike) -> str:
        """Judge a response (responses, samples) to a new drive."""
        ...


def corrected_drive(
    bus: Bus,
    drive: NDArray[np.float64],
    *,
    response: NDArray[np.float64] | None,
    parent: str,
    corrected_by: str,
    id: str,
    description: rig_pb2.RigDescription,
    playbacks: int,
    passed_limit: PassedLimit,
    stop: threading.Event,
    on_activity: Callable[[str], None],
) -> NDArray[np.float64]:
    """Let the iterator correct a drive; return the drive of its best playback, shape (drives, samples).

    `response`: Response of the last repeat, if the rig cannot have been changed since; otherwise `drive` is played once
    more. `parent`: Campaign of the event's first drive, whose target, settings and model are used. `corrected_by`:
    Campaign of the present drive; empty for the first one. `id`: Id of the new campaign. `playbacks`: Largest number of
    corrections. `passed_limit`: Returns the abort limit that a playback passes; one ends the campaign.
    Raises FaultError: Reason why there is no better drive; CANCELLED if `stop` was set, which also stops the campaign.
    """
    spec = _specification(bus, parent)
    spec.id = id
    if spec.update.kind == iterator_pb2.UPDATE_KIND_SECANT and not spec.update.HasField("plugin"):
        # Steps of the new specimen are left out: no model explains both, and the misfit makes steps cautious and wrong.
        fill_message(spec.update, update_of_worn(from_message(spec.update, ResolvedUpdate, field="update")))
    else:
        # The rig is the same except for its wear.
        spec.known.learn_from.extend(filter(None, (parent, corrected_by)))
    first, rate = spec.known.first_drive, description.sample_rate
    first.source = "the endurance test"
    first.drive.CopyFrom(to_record(description.drives, rate, drive))
    spec.stop.iterations = playbacks
    if response is not None:
        first.response.CopyFrom(to_record(description.responses, rate, response))
        first.of_this_target = True
    else:
        spec.stop.iterations += 1
    limit_of = partial(limit_of_playbacks, bus, id, passed_limit, responses=len(description.responses))
    status = _status_at_end(bus, spec, limit_of=limit_of, stop=stop, on_activity=on_activity)
    if status.phase != iterator_pb2.CAMPAIGN_PHASE_FINISHED:
        raise FaultError(
            status.fault.code or query_pb2.FAULT_CODE_INTERNAL,
            f"Campaign {id!r} ended early: {status.fault.message or status.activity}",
        )
    best = _better_playback(status, _weights(spec))
    for message, step in _steps(bus, id, with_samples=True):
        if isinstance(message, iterator_pb2.IterationStep) and message.iteration == best:
            samples = step.drive if step.HasField("drive") else message.drive.samples
            return from_array(samples, field="drive", shape=drive.shape, dtype=np.float64)
    raise FaultError(query_pb2.FAULT_CODE_DATA_LOSS, f"Campaign {id!r} recorded no playback {best}.")


def _status_at_end(
    bus: Bus,
    spec: iterator_pb2.CampaignSpec,
    *,
    limit_of: Callable[[], str],
    stop: threading.Event,
    on_activity: Callable[[str], None],
) -> iterator_pb2.CampaignStatus:
    """Run a correction to its end; stop it if `stop` is set, or at a limit passed by a playback, from `limit_of`."""
    status = bus.query(bus.keys.campaign_start(spec.rig), spec, iterator_pb2.CampaignStatus)
    judged, passed = 0, ""
    while True:
        is_over = status.phase in _ENDED
        if len(status.iterations) > judged:
            try:
                passed, judged = limit_of(), len(status.iterations)
            except FaultError:
                # The recorder may be away for a moment; at the end each playback is judged.
                if is_over:
                    raise
        if passed:
            _stop_campaign(bus, spec.id, passed)
            raise FaultError(
                query_pb2.FAULT_CODE_FAILED_PRECONDITION,
                f"In campaign {spec.id!r} {passed}; the drive stays, so look at the specimen, and change the limits if "
                "they are too narrow.",
            )
        if is_over:
            return status
        on_activity(status.activity)
        if stop.wait(_POLL_SECONDS):
            _stop_campaign(bus, spec.id, "the endurance test was stopped")
            raise FaultError(query_pb2.FAULT_CODE_CANCELLED, "Stopped on request.")
        status = bus.query(bus.keys.campaign(spec.id), iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus)


def wait_for_end(
    bus: Bus,
    campaign: str,
    *,
    stop: threading.Event,
    on_activity: Callable[[str], None],
    limit_of: Callable[[], str],
) -> str:
    """Wait until a campaign has ended, which a crash of the sequencer does not end; stop it if `stop` is set.

    A campaign that the iterator does not know, or whose iterator is not heard for 10 s, has ended. `limit_of`: Returns
    the abort limit that a playback passed, as a clause; one stops the campaign and is returned.
    """
    last_heard, judged, passed = time.monotonic(), 0, ""
    while True:
        try:
            status = bus.query(bus.keys.campaign(campaign), iterator_pb2.CampaignRequest(), iterator_pb2.CampaignStatus)
            last_heard, is_judged = time.monotonic(), True
            if len(status.iterations) > judged:
                passed, is_judged = _judged(limit_of)
                judged = len(status.iterations) if is_judged else judged
            if passed:
                _stop_campaign(bus, campaign, passed)
                return passed
            if status.phase in _ENDED and is_judged:
                return ""
            on_activity(status.activity)
            if stop.wait(_POLL_SECONDS):
                _stop_campaign(bus, campaign, "the endurance test was stopped")
                return ""
        except FaultError as fault:
            is_over = fault.code == query_pb2.FAULT_CODE_NOT_FOUND or time.monotonic() > last_heard + _SILENCE_SECONDS
            if is_over or stop.wait(_POLL_SECONDS):
                return passed or _judged(limit_of)[0]


def _judged(limit_of: Callable[[], str]) -> tuple[str, bool]:
    """Return the passed limit, and whether that is known: not while the recorder is away."""
    try:
        return limit_of(), True
    except FaultError as fault:
        # A recording that cannot be read is reported where its playbacks are counted.
        return "", fault.code not in AWAY


def _stop_campaign(bus: Bus, campaign: str, reason: str) -> None:
    """Stop a campaign, and stop and latch its rig in any state; one that has ended stays as it is."""
    request = iterator_pb2.StopCampaignRequest(reason=reason)
    bus.query(bus.keys.campaign_stop(campaign), request, iterator_pb2.CampaignStatus)


def limit_of_playbacks(bus: Bus, campaign: str, passed_limit: PassedLimit, *, responses: int) -> str:
    """Return the abort limit that a playback of a correction passed, as a clause; empty if none did.

    The response to the present drive is that of the specification; without one, the first playback is of that drive.
    Raises FaultError if the recording cannot be read.
    """
    present = None
    for message, step in _steps(bus, campaign, with_samples=True):
        if isinstance(message, iterator_pb2.CampaignSpec) and message.known.first_drive.HasField("response"):
            present = from_record(message.known.first_drive.response, field="response")[2]
        elif isinstance(message, iterator_pb2.IterationStep):
            response = _response(message, step, responses=responses)
            if response is None:
                continue
            if present is None:
                present = response
            elif limit := passed_limit(response, present=present):
                return f"playback {message.iteration} passed an abort limit of the schedule ({limit})"
    return ""


def playbacks_of(
    bus: Bus, campaign: str, *, responses: int, damage_of: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> tuple[int, list[NDArray[np.float64]]]:
    """Return the number of playbacks that a campaign announced, and the damage of those with a recorded response.

    A campaign without a recording announced none. `damage_of`: Returns the damage of a response, shape (responses,).
    Raises FaultError if its recording cannot be read.
    """
    try:
        return _playbacks(bus, campaign, responses=responses, damage_of=damage_of, with_samples=True)
    except FaultError as fault:
        if fault.code == query_pb2.FAULT_CODE_NOT_FOUND:
            return 0, []
        if fault.code in AWAY:
            raise
    # Samples are missing: their playbacks were announced all the same.
    return _playbacks(bus, campaign, responses=responses, damage_of=damage_of, with_samples=False)


def _playbacks(
    bus: Bus,
    campaign: str,
    *,
    responses: int,
    damage_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    with_samples: bool,
) -> tuple[int, list[NDArray[np.float64]]]:
    announced: set[str] = set()
    damage: dict[str, NDArray[np.float64]] = {}
    for message, step in _steps(bus, campaign, with_samples=with_samples):
        if isinstance(message, recorder_pb2.RunPlanned):
            announced.add(message.run)
        elif isinstance(message, iterator_pb2.IterationStep):
            response = _response(message, step, responses=responses)
            if response is not None:
                damage[message.run] = damage_of(response)
    return len(announced), [damage[run] for run in sorted(announced & damage.keys())]


def _response(
    message: iterator_pb2.IterationStep, step: recorder_pb2.RecordedStep, *, responses: int
) -> NDArray[np.float64] | None:
    """Return the recorded response of a playback, shape (responses, samples); None if it is missing or damaged."""
    if not (step.HasField("response") or message.HasField("response")):
        return None
    samples = step.response if step.HasField("response") else message.response.samples
    with suppress(ArrayError):
        return from_array(samples, field="response", shape=(responses, None), dtype=np.float64)
    return None


def _better_playback(status: iterator_pb2.CampaignStatus, weights: Mapping[str, float]) -> int:
    """Return the number of the best playback of a finished correction: the one with the smallest weighted error.

    If the target was reached, only the last playback fulfils all criteria.
    Raises FaultError FAILED_PRECONDITION if it is not better than the present drive: the first drive with its response,
    or playback 1 if it was played once more.
    """
    numbered = {metrics.iteration: metrics for metrics in status.iterations}
    present = status.first_drive if status.HasField("first_drive") else numbered.get(1)
    if present is None or status.best_iteration not in numbered:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION,
            f"Campaign {status.id!r} has {len(numbered)} playbacks and no best one; the drive stays. See its remarks.",
        )
    errors = {number: _weighted_error(metrics, weights) for number, metrics in numbered.items()}
    if status.outcome == iterator_pb2.OUTCOME_REACHED:
        errors = {status.best_iteration: errors[status.best_iteration]}
    best, before = min(errors, key=errors.__getitem__), _weighted_error(present, weights)
    if errors[best] < before:
        return best
    weighted = ", with the campaign's weights," if len(set(weights.values()) - {0.0}) > 1 else ""
    raise FaultError(
        query_pb2.FAULT_CODE_FAILED_PRECONDITION,
        f"In campaign {status.id!r} no playback was better; the drive stays. Its error in the control band{weighted} "
        f"is {before:.3g}, that of the best playback {errors[best]:.3g}: continue with it, or look at the specimen.",
    )


def _weighted_error(metrics: iterator_pb2.IterationMetrics, weights: Mapping[str, float]) -> float:
    """Return the root mean square of the channels' weighted errors over that of the weights; the update minimises it.

    With equal weights it is the overall error of the campaign.
    """
    pairs = [(weights.get(each.channel, 1.0), each.relative_rms_error) for each in metrics.channels]
    # A response of weight 0 may have no error, because its target is silent.
    controlled = [(weight, error) for weight, error in pairs if weight > 0.0]
    if len({weight for weight, _ in controlled}) <= 1:
        return metrics.overall_relative_rms_error
    squares = sum((weight * error) ** 2 for weight, error in controlled)
    return float(np.sqrt(squares / sum(weight**2 for weight, _ in controlled)))


def _weights(spec: iterator_pb2.CampaignSpec) -> dict[str, float]:
    """Return the weight of each response of a campaign; 1 without weights, 0 for a monitored response."""
    names = [channel.name for channel in spec.target.channels]
    weights = np.ones(len(names))
    if spec.update.HasField("weights"):
        weights = from_array(spec.update.weights, field="weights", shape=weights.shape, dtype=np.float64)
    return dict(zip(names, map(float, weights), strict=True))


@dataclass(frozen=True)
class ControlledPart:
    """Part of the responses that a campaign controls, and that another drive can change on purpose.

    `channels`: Names of the controlled responses. `band`: Lowest and highest frequency of the control band in Hz.
    """

    channels: frozenset[str]
    band: tuple[float, float]

    def uncorrectable(self, alarms: Sequence[Alarm]) -> list[tuple[Alarm, str]]:
        """Return the alarms of a repeat that no drive corrects, each with the reason, without a full stop."""
        shifted = {alarm.channel for alarm in alarms if alarm.measure in _STATIC}
        reasons = [(alarm, self._reason(alarm, is_shifted=alarm.channel in shifted)) for alarm in alarms]
        return [(alarm, reason) for alarm, reason in reasons if reason]

    def _reason(self, alarm: Alarm, *, is_shifted: bool) -> str:
        low, high = self.band
        if alarm.channel not in self.channels:
            return f"{alarm.channel} is not controlled, its weight is 0"
        if alarm.measure in _STATIC or (is_shifted and alarm.measure in _WITH_MEAN):
            band = f"the control band of {low:g} to {high:g} Hz"
            return "" if low == 0.0 else f"the static part of {alarm.channel} is outside {band}"
        if alarm.band is not None and (alarm.band[1] <= low or alarm.band[0] >= high):
            where = f"{alarm.channel} at {alarm.band[0]:g} to {alarm.band[1]:g} Hz"
            return f"{where} is outside the control band of {low:g} to {high:g} Hz"
        return ""


def controlled_part(bus: Bus, campaign: str) -> ControlledPart:
    """Return what a recorded campaign controls; raises FaultError if its recording cannot be read."""
    for message, _ in _steps(bus, campaign):
        if isinstance(message, iterator_pb2.CampaignSpec):
            controlled = frozenset(name for name, weight in _weights(message).items() if weight > 0.0)
            return ControlledPart(controlled, (message.lowest_frequency, message.highest_frequency))
    raise FaultError(
        query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"The recording {campaign!r} holds no specification of a campaign."
    )


def update_of_worn(update: ResolvedUpdate) -> ResolvedUpdate:
    """Return the settings of a secant update for a rig that has changed since its identification.

    The present response and each new step have the largest weight, the identified model a smaller one, and each line is
    fitted to the lines of the whole record around it: the change is narrower than the lines of averaged blocks. Speeds
    of the drives are learned: a damper that leaks changes what they do. The rig responds more to a small step than to a
    large one, hence the gain.
    """
    secant = update.secant
    learning = {
        "forgetting": min(secant.forgetting, _FORGETTING),
        "prior_strength": min(secant.prior_strength, _PRIOR_STRENGTH),
        "speed_terms": True,
        "whole_record": True,
    }
    return update.model_copy(
        update={
            "secant": secant.model_copy(update=learning),
            "iteration_gain": tuple(_GAIN * gain for gain in update.iteration_gain),
        }
    )


def _specification(bus: Bus, parent: str) -> iterator_pb2.CampaignSpec:
    """Return the parent's campaign with its model as the known one."""
    spec, model = iterator_pb2.CampaignSpec(), None
    for message, _ in _steps(bus, parent):
        match message:
            case iterator_pb2.CampaignSpec():
                spec.CopyFrom(message)
                model = message.known.model if message.known.HasField("model") else None
            case identifier_pb2.Model():
                # The last one counts: an identification may have two experiments.
                model = message
            case iterator_pb2.IterationStep():
                break
    if model is None:
        raise FaultError(
            query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"The recording {parent!r} holds no model of its rig."
        )
    for name in ("parent", "parent_iteration", "levels", "confirmations", "pre_test", "known", "at_target"):
        spec.ClearField(name)
    # The person who decided, or wrote the schedule, has allowed the playback.
    spec.hold.CopyFrom(iterator_pb2.HoldSettings(when=iterator_pb2.HOLD_POINT_NEVER))
    spec.known.model.CopyFrom(model)
    spec.known.model_source = parent
    spec.excitation.CopyFrom(model.excitation)
    spec.excitation.seed = 0
    spec.estimator.CopyFrom(model.estimator)
    return spec


def _steps(
    bus: Bus, recording: str, *, with_samples: bool = False
) -> Iterator[tuple[Message, recorder_pb2.RecordedStep]]:
    """Yield the specification, the model, the iterations and the announced runs of a campaign."""
    for step in recorded_steps(bus, recording, with_samples=with_samples):
        if step.message_type in _KINDS:
            yield message_of_step(recording, step, _KINDS, of="a campaign"), step
