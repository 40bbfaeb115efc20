"""Identifier on the bus: answers queries with models and faults."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import structlog
from numpy.typing import NDArray
from pydantic import Field

from duralab_bus import Bus, Call, FaultError, ServiceConfig, SpanKind, span
from duralab_drive_map import DriveMap
from duralab_drive_map.messages import to_message as drive_map_message
from duralab_proto.keys import ANY, id_of
from duralab_proto.v1 import identifier_pb2, query_pb2, rig_pb2
from duralab_settings import SettingsError
from identifier.bus import (
    advise,
    converge,
    describe_rig,
    difference,
    drive_room,
    level_series,
    play_experiment,
    predict,
    settings_of,
    shape_from,
)
from identifier.estimators import FrfEstimate
from identifier.excitation import Experiment
from identifier.experiment import (
    IdentificationSettings,
    RigUnderTest,
    TargetShape,
    check_against_rig,
    estimate_experiment,
    estimate_shaped,
    make_experiment,
    measured_static_gain,
    shaped_experiment,
    with_names,
)
from identifier.modelling import (
    IdentifiedModel,
    ModelCache,
    distortion_of,
    from_message,
    learn_map,
    model_of,
    plan_message,
    to_message,
    valid_band,
    with_shape,
)

SERVICE = "identifier"

# Shares of the whole query, for its progress: nearly all of the time is the rig's.
_PLAYING_FROM, _PLAYING_TO = 0.02, 0.95


class IdentifierConfig(ServiceConfig):
    """Configuration of the identifier."""

    # Number of models for identifier/model/<id>; a model of six drives and 2049 lines takes 3.4 MB.
    kept_models: int = Field(default=32, ge=1, le=10_000)


@dataclass(frozen=True)
class _Prepared:
    """An experiment that the rig can play."""

    settings: IdentificationSettings
    rig: RigUnderTest
    experiment: Experiment
    shape: TargetShape | None = None
    shaping_model: IdentifiedModel | None = None

    @property
    def start_map(self) -> DriveMap | None:
        """Drive map that is learned again; None if none was chosen before."""
        before = None if self.shape is None else self.shape.drive_map
        return None if before is None or before.is_identity else before

    def estimate(self, mapped: NDArray[np.float64], response: NDArray[np.float64]) -> FrfEstimate:
        """Estimate the FRF from mapped drives to responses."""
        estimator, layout = self.settings.estimator, self.experiment.layout
        if self.shape is None:
            return estimate_experiment(estimator, layout, drive=mapped, response=response)
        return estimate_shaped(self.shape, estimator, layout, mapped=mapped, response=response)

    def inputs(self, mapped: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the independent inputs of the experiment: the mapped drives, or the responses predicted for them."""
        return mapped if self.shape is None else self.shape.predicted(mapped).response


class IdentifierService:
    """Serves everything under identifier/.

    `bus`: Open bus. `config`: Configuration of the service.
    """

    def __init__(self, bus: Bus, config: IdentifierConfig) -> None:
        self._bus = bus
        self._cache = ModelCache(config.kept_models)
        self._log = structlog.get_logger(SERVICE)
        self._identified_rigs = bus.metrics.count(
            "duralab_identifier_models_total", "Models identified, by rig", labels=("rig",)
        )
        bus.metrics.follow(
            "duralab_identifier_kept_models", "Models that can be asked for", lambda: {(): float(len(self._cache))}
        )
        keys = bus.keys
        bus.serve(keys.identify(ANY), identifier_pb2.IdentifyRequest, self.identify)
        bus.serve(keys.experiment_plan(), identifier_pb2.PlanRequest, self.plan)
        bus.serve(keys.identify_levels(ANY), identifier_pb2.LevelsRequest, self.levels)
        bus.serve(keys.level_advice(), identifier_pb2.AdviceRequest, self.advice)
        bus.serve(keys.model(ANY), identifier_pb2.ModelRequest, self.model)
        bus.serve(keys.prediction(ANY), identifier_pb2.PredictRequest, self.prediction)
        bus.serve(keys.convergence(ANY), identifier_pb2.ConvergenceRequest, self.convergence)

    def identify(self, request: identifier_pb2.IdentifyRequest, call: Call) -> identifier_pb2.Model:
        """Run an experiment on a rig and answer with the model."""
        call.require_rig(request.rig, field="rig")
        prepared = self._prepare(request, call)
        if request.check_only:
            plan = self._plan_of(prepared)
            return identifier_pb2.Model(
                plan=plan, lowest_frequency=plan.lowest_frequency, highest_frequency=plan.highest_frequency
            )
        return self._identified(request, prepared, call, progress=(_PLAYING_FROM, _PLAYING_TO))

    def plan(self, request: identifier_pb2.PlanRequest, call: Call) -> identifier_pb2.ExperimentPlan:
        """Answer with duration and results of an experiment, without a motion."""
        with _within("identify"):
            return self._plan_of(self._prepare(request.identify, call))

    def levels(self, request: identifier_pb2.LevelsRequest, call: Call) -> identifier_pb2.LevelsResult:
        """Run one experiment at several levels and answer with the differences."""
        call.require_rig(request.identify.rig, field="identify.rig")
        with _invalid():
            series = level_series(request)
        with _within("identify"):
            prepared = [self._prepare(one, call) for one in series]
        messages: list[identifier_pb2.Model] = []
        for index, (one, ready) in enumerate(zip(series, prepared, strict=True)):
            share = (_PLAYING_TO - _PLAYING_FROM) / len(series)
            begin = _PLAYING_FROM + index * share
            messages.append(self._identified(one, ready, call, progress=(begin, begin + share)))
        models = [from_message(message) for message in messages]
        differences = [difference(*pair) for pair in pairwise(models)]
        return identifier_pb2.LevelsResult(models=messages, differences=differences)

    def model(self, _request: identifier_pb2.ModelRequest, call: Call) -> identifier_pb2.Model:
        """Answer with a model made earlier."""
        return self._held(id_of(call.key))

    def prediction(self, request: identifier_pb2.PredictRequest, call: Call) -> identifier_pb2.Prediction:
        """Answer with the predicted response of a model to a drive."""
        with _invalid():
            return predict(self._held_model(id_of(call.key)), request)

    def convergence(self, request: identifier_pb2.ConvergenceRequest, call: Call) -> identifier_pb2.Convergence:
        """Answer with the convergence of Time Waveform Replication with a model."""
        rig = self._held_model(request.rig_model_id, field="rig_model_id") if request.rig_model_id else None
        call.progress("judging the convergence", 0.0)
        with _invalid():
            return converge(self._held_model(id_of(call.key)), request, rig=rig)

    def advice(self, request: identifier_pb2.AdviceRequest, call: Call) -> identifier_pb2.LevelAdvice:
        """Answer with the drive levels whose responses are like a target's."""
        if not request.model_id:
            raise FaultError(
                query_pb2.FAULT_CODE_INVALID_ARGUMENT,
                "No model is named, and without one the effect of a drive on the rig is unknown: identify it at a low "
                "level first, e.g. with an RMS of a hundredth of each drive's limit, and ask with that model's id.",
                field="model_id",
            )
        call.progress("looking for levels", 0.0)
        model = self._held_model(request.model_id, field="model_id")
        try:
            room = drive_room(model)
        except ValueError as error:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error
        with _invalid():
            return advise(model, request, room=room)

    def _prepare(self, request: identifier_pb2.IdentifyRequest, call: Call) -> _Prepared:
        with _invalid(), span("make the drives", SpanKind.MATHEMATICS):
            settings = settings_of(request)
            call.progress("asking the rig what it is", 0.0)
            rig = describe_rig(self._bus, request.rig)
            check_against_rig(settings, rig)
            call.progress("making the drives", 0.0)
            if not request.HasField("shape"):
                return _Prepared(settings=settings, rig=rig, experiment=make_experiment(settings.excitation, rig))
            wanted, model = shape_from(request.shape, rig=rig)
            experiment, shape = shaped_experiment(wanted, settings.excitation, rig=rig)
            return _Prepared(settings=settings, rig=rig, experiment=experiment, shape=shape, shaping_model=model)

    def _plan_of(self, prepared: _Prepared) -> identifier_pb2.ExperimentPlan:
        band = valid_band(prepared.experiment.layout)
        return plan_message(prepared.settings.excitation, rig=prepared.rig, band=band)

    def _identified(
        self,
        request: identifier_pb2.IdentifyRequest,
        prepared: _Prepared,
        call: Call,
        *,
        progress: tuple[float, float],
    ) -> identifier_pb2.Model:
        rig, layout, drive = prepared.rig, prepared.experiment.layout, prepared.experiment.drive
        log = self._log.bind(run=request.run, rig=request.rig)
        log.info("playing", seconds=drive.shape[1] / layout.sample_rate, drives=len(rig.drives))
        played, response = play_experiment(self._bus, request, rig=rig, drive=drive, call=call, progress=progress)
        with span("estimate", SpanKind.MATHEMATICS):
            return self._modelled(request, prepared, played, response, call, at=progress[1])

    def _modelled(
        self,
        request: identifier_pb2.IdentifyRequest,
        prepared: _Prepared,
        played: rig_pb2.PlayResult,
        response: NDArray[np.float64],
        call: Call,
        *,
        at: float,
    ) -> identifier_pb2.Model:
        """Return the model of a playback, and cache it."""
        rig, layout, drive = prepared.rig, prepared.experiment.layout, prepared.experiment.drive
        call.progress("estimating the FRF", at)
        excitation = prepared.settings.excitation
        static = None
        if prepared.shape is None:
            static = measured_static_gain(drive, response, excitation, sample_rate=layout.sample_rate)
        # The holds follow the record of the FRF.
        drive, response = drive[:, : layout.samples], response[:, : layout.samples]
        try:
            estimate, mapped, drive_map = self._estimated(prepared, drive, response, call, at=at)
            levels = distortion_of(prepared.inputs(mapped), response, layout)
        except ValueError as error:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, with_names(str(error), rig)) from error
        model = model_of(
            request,
            settings=excitation,
            rig=rig,
            layout=layout,
            estimate=estimate,
            static=static,
            played=played,
            response=response,
            levels=levels,
            drive_map=drive_map,
        )
        if prepared.shape is not None and prepared.shaping_model is not None:
            wanted_level = request.shape.level
            model = with_shape(model, prepared.shape, after=prepared.shaping_model, wanted_level=wanted_level)
        message = to_message(model)
        self._cache.put(message)
        self._identified_rigs.add(request.rig)
        self._log.info(
            "identified",
            run=request.run,
            rig=request.rig,
            model=message.id,
            blocks=message.blocks,
            warnings=len(message.warnings),
        )
        return message

    def _estimated(
        self,
        prepared: _Prepared,
        drive: NDArray[np.float64],
        response: NDArray[np.float64],
        call: Call,
        *,
        at: float,
    ) -> tuple[FrfEstimate, NDArray[np.float64], identifier_pb2.DriveMap | None]:
        """Return the estimate, its drives, and their map if one is requested."""
        settings, start = prepared.settings, prepared.start_map
        before = drive if start is None else start.to_mapped(drive)
        estimate = prepared.estimate(before, response)
        kept = None if prepared.shaping_model is None else prepared.shaping_model.drive_map
        if not settings.learn_drive_map:
            return estimate, before, kept
        call.progress("learning the drive map", at)
        learned = learn_map(
            drive,
            response,
            estimate=estimate,
            estimate_again=lambda mapped: prepared.estimate(mapped, response),
            rig=prepared.rig,
            response_weight=None if settings.response_weight is None else np.array(settings.response_weight),
            start=start,
        )
        if start is not None and kept is not None and not learned.chosen:
            found = identifier_pb2.DriveMap()
            found.CopyFrom(kept)
            found.remarks.extend(learned.remarks)
        else:
            found = drive_map_message(learned)
        return learned.model.estimate, learned.drive_map.to_mapped(drive), found

    def _held(self, wanted: str, *, field: str = "") -> identifier_pb2.Model:
        message = self._cache.get(wanted)
        if message is None:
            raise FaultError(
                query_pb2.FAULT_CODE_NOT_FOUND,
                f"The identifier holds no model {wanted!r}; it keeps the {self._cache.capacity} used last since it was "
                "started, so read older ones from the recording of their campaign.",
                field=field,
            )
        return message

    def _held_model(self, wanted: str, *, field: str = "") -> IdentifiedModel:
        return from_message(self._held(wanted, field=field))


@contextmanager
def _invalid() -> Iterator[None]:
    """Convert an error of a setting to a fault."""
    try:
        yield
    except SettingsError as error:
        raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field=error.field) from error


@contextmanager
def _within(field: str) -> Iterator[None]:
    """Add the field of a request that holds the faulty message to a fault."""
    try:
        yield
    except FaultError as fault:
        if not fault.field:
            raise
        raise FaultError(fault.code, fault.message, field=f"{field}.{fault.field}", service=fault.service) from fault
