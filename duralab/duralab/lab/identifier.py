"""Identification of a rig from a script: plan, experiment, and queries about the model."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, TypeVar, cast

import numpy as np
from google.protobuf.message import Message

from duralab.arguments import progress_callback, real_numbers, require_seed
from duralab.campaign import estimator_message, excitation_message
from duralab.data import Convergence, ExperimentPlan, LevelAdvice, LevelSeries, Model, ModelDifference, Rig, Signals
from duralab.errors import InputError
from duralab.lab.client import LabClient, deadline_of
from duralab.lab.playing import halting
from duralab.lab.progress import RunProgress, Stage
from duralab_proto.arrays import from_array, to_array
from duralab_proto.v1 import array_pb2, identifier_pb2, query_pb2
from duralab_settings import EstimatorSettings, ExcitationSettings


class Identifier:
    """The identifier of a lab; made by `Lab.identifier`."""

    def __init__(self, ask: LabClient, describe: Callable[[str], Rig]) -> None:
        self._ask, self._describe, self._keys = ask, describe, ask.bus.keys

    def plan(
        self, rig: str, excitation: ExcitationSettings, estimator: EstimatorSettings, *, seed: int = 0
    ) -> ExperimentPlan:
        """Return the plan of an experiment: its duration and expected result; nothing moves.

        Parameters
        ----------
        rig, excitation, estimator, seed
            As for `identify`.

        Returns
        -------
        ExperimentPlan
            Plan of the experiment; prints as a table.

        Raises
        ------
        InputError
            The rig could not play the experiment, or the experiment would not identify the rig.
        """
        request = identifier_pb2.PlanRequest(identify=self._request(rig, excitation, estimator, seed=seed))
        plan = self._ask.query(self._keys.experiment_plan(), request, identifier_pb2.ExperimentPlan)
        return _decoded(ExperimentPlan, plan, band=(plan.lowest_frequency, plan.highest_frequency))

    def identify(
        self,
        rig: str,
        excitation: ExcitationSettings,
        estimator: EstimatorSettings,
        *,
        seed: int = 0,
        learn_drive_map: bool = False,
        target: Signals | None = None,
        band: tuple[float, float] | None = None,
        on_progress: Callable[[RunProgress], None] | None = None,
        timeout_seconds: float | None = None,
        cancel: threading.Event | None = None,
    ) -> Model:
        """Run an experiment on a rig, and with a target a second one at its level; return the model.

        Parameters
        ----------
        rig : str
            Name of the rig.
        excitation, estimator : ExcitationSettings, EstimatorSettings
            Settings as in a campaign file.
        seed : int
            Seed of the excitation's phases and of the random parts of a simulated rig.
        learn_drive_map : bool
            Whether to learn which drives follow products of other drives, as in a campaign. If some do, `Model.frf` is
            from mapped drives, and `predict` maps a drive first.
        target : Signals, optional
            Target of as many responses as the rig has drives, for the second experiment of `excitation.at_target`. Not
            given: only the first experiment is played.
        band : tuple of float, optional
            Band of the target in Hz; needed with a target.
        on_progress : callable, optional
            Called with a `RunProgress` about once a second.
        timeout_seconds : float, optional
            Longest time to wait; then the rig is stopped and latched.
        cancel : threading.Event, optional
            If another thread sets it, the rig is stopped and latched.

        Returns
        -------
        Model
            Identified model; the identifier keeps it until newer models replace it.

        Raises
        ------
        LabError
            The rig could not play the experiment (`InputError`), or the experiment did not identify the rig.
        """
        request = self._request(rig, excitation, estimator, seed=seed)
        shape = _target_shape(excitation, target, band)
        if learn_drive_map:
            request.drive_map.SetInParent()
        end = deadline_of(timeout_seconds, cancel)

        def played() -> identifier_pb2.Model:
            return self._ask.query(
                self._keys.identify(rig),
                request,
                identifier_pb2.Model,
                on_progress=_report_to(on_progress),
                deadline=end,
                what=f"The identification of rig {rig!r}",
            )

        with halting(self._ask, rig, end):
            message = played()
            if shape is not None and excitation.at_target is not None:
                request.run = f"{request.run}.at_target"
                request.excitation.duration = excitation.at_target.duration
                request.excitation.realisations = 0
                request.excitation.static_hold = 0.0
                # Other phases and other noise than in the first experiment.
                request.excitation.seed, request.rig_seed = seed + 1, seed + 1
                shape.model.CopyFrom(message)
                request.shape.CopyFrom(shape)
                message = played()
        return Model.from_message(message)

    def levels(
        self,
        rig: str,
        excitation: ExcitationSettings,
        estimator: EstimatorSettings,
        *,
        factors: Sequence[float],
        seed: int = 0,
        on_progress: Callable[[RunProgress], None] | None = None,
    ) -> LevelSeries:
        """Run one experiment at 2 to 8 levels, the lowest first, and return the models and their differences.

        Parameters
        ----------
        rig, excitation, estimator, seed, on_progress
            As for `identify`.
        factors : sequence of float
            Factors of the excitation's levels, 2 to 8 of them.

        Returns
        -------
        LevelSeries
            Models, and the difference of each to the previous one.

        Raises
        ------
        LabError
            The rig could not play one of the levels (`InputError`; nothing moved), or it was not identified.
        """
        request = identifier_pb2.LevelsRequest(
            identify=self._request(rig, excitation, estimator, seed=seed),
            factors=to_array(real_numbers(factors, what="factors", field="factors")),
        )
        answer = self._ask.query(
            self._keys.identify_levels(rig), request, identifier_pb2.LevelsResult, on_progress=_report_to(on_progress)
        )
        return LevelSeries(
            models=tuple(Model.from_message(message) for message in answer.models),
            differences=tuple(_decoded(ModelDifference, message) for message in answer.differences),
        )

    def predict(self, model: Model, drive: Signals) -> Signals:
        """Return the response that a model predicts for a drive, in the model's band and without static part.

        Parameters
        ----------
        model : Model
            Model that the identifier still keeps.
        drive : Signals
            Signals of the model's drives, in their units.

        Returns
        -------
        Signals
            Predicted responses, as long as the drive.
        """
        request = identifier_pb2.PredictRequest(drive=drive.to_message())
        answer = self._ask.query(self._keys.prediction(model.id), request, identifier_pb2.Prediction)
        return Signals.from_message(answer.response, field="response")

    def convergence(
        self, model: Model, *, gain: float, band: tuple[float, float], rig_model: Model | None = None
    ) -> Convergence:
        """Predict how Time Waveform Replication with the model's inverse converges in a band in Hz.

        A `rig_model`, e.g. from a higher level, represents the rig instead of `model`.

        Parameters
        ----------
        model : Model
            Model whose inverse is used.
        gain : float
            Iteration gain of all responses, greater than 0, at most 1.
        band : tuple of float
            Band in Hz, inside the bands of `model` and `rig_model`.
        rig_model : Model, optional
            Model that represents the rig.

        Returns
        -------
        Convergence
            Prediction per frequency line, and as a sentence.
        """
        request = identifier_pb2.ConvergenceRequest(
            iteration_gain=to_array(np.full(len(model.responses), float(gain))),
            lowest_frequency=band[0],
            highest_frequency=band[1],
            rig_model_id="" if rig_model is None else rig_model.id,
        )
        answer = self._ask.query(self._keys.convergence(model.id), request, identifier_pb2.Convergence)
        return _decoded(Convergence, answer)

    def advise(self, model: Model, target: Signals, *, band: tuple[float, float]) -> LevelAdvice:
        """Return the drive levels that give responses at the level of a target's in a band in Hz.

        Parameters
        ----------
        model : Model
            Model of the rig, from any level.
        target : Signals
            Target of the model's responses, in their units.
        band : tuple of float
            Band in Hz.

        Returns
        -------
        LevelAdvice
            Advice; prints as a table.
        """
        request = identifier_pb2.AdviceRequest(
            model_id=model.id, target=target.to_message(), lowest_frequency=band[0], highest_frequency=band[1]
        )
        answer = self._ask.query(self._keys.level_advice(), request, identifier_pb2.LevelAdvice)
        stated = answer.HasField("identification_damage")
        damage = from_array(answer.identification_damage) if stated else None
        return _decoded(LevelAdvice, answer, identification_damage=damage)

    def _request(
        self, rig: str, excitation: ExcitationSettings, estimator: EstimatorSettings, *, seed: int
    ) -> identifier_pb2.IdentifyRequest:
        described = self._describe(rig)
        require_seed(seed)
        for name, section, kind in (
            ("excitation", excitation, ExcitationSettings),
            ("estimator", estimator, EstimatorSettings),
        ):
            if not isinstance(section, kind):
                raise InputError(f"{name} is {section!r}; give {kind.__name__}, e.g. of a campaign.", field=name)
        return identifier_pb2.IdentifyRequest(
            rig=rig,
            excitation=excitation_message(excitation, rig=described, seed=seed),
            estimator=estimator_message(estimator),
            run=f"identify-{uuid.uuid4().hex[:12]}",
            rig_seed=seed,
        )


def _target_shape(
    excitation: ExcitationSettings, target: Signals | None, band: tuple[float, float] | None
) -> identifier_pb2.TargetShape | None:
    """Return the shape of the second experiment, without its model, if a target for it is given."""
    if target is None and band is None:
        return None
    if target is None or band is None:
        missing = "target" if target is None else "band"
        raise InputError(f"{missing} is not given; a second experiment needs target and band, so give both.")
    if excitation.at_target is None:
        raise InputError(
            "target is given and excitation.at_target is not; give its level and duration, or leave the target out.",
            field="excitation.at_target",
        )
    return identifier_pb2.TargetShape(
        target=target.to_message(),
        lowest_frequency=band[0],
        highest_frequency=band[1],
        level=excitation.at_target.level,
    )


ValueT = TypeVar("ValueT")


def _decoded(kind: type[ValueT], message: Message, **given: object) -> ValueT:
    """Return a dataclass with the message's fields of the same names, and with the `given` ones."""
    values = {
        field.name: getattr(message, field.name) for field in fields(cast("Any", kind)) if field.name not in given
    }
    for name, value in values.items():
        if isinstance(value, array_pb2.Array):
            values[name] = from_array(value)
        elif not isinstance(value, str | int | float):
            values[name] = tuple(value)
    return kind(**values, **given)


def _report_to(on_progress: Callable[[RunProgress], None] | None) -> Callable[[query_pb2.Progress], None]:
    report_progress = progress_callback(on_progress)

    def report(progress: query_pb2.Progress) -> None:
        report_progress(
            RunProgress(Stage.IDENTIFICATION, progress.phase, progress.fraction, progress.remaining_seconds)
        )

    return report
