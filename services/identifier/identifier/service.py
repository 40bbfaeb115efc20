"""The identifier on the bus: queries in, models and faults out."""

import threading

import numpy as np
import structlog
from pydantic import Field

from duralab_proto.arrays import ArrayError, from_record, to_record
from duralab_proto.keys import id_of
from duralab_proto.v1 import identifier_pb2, query_pb2, rig_pb2
from identifier.excitation import make_drive
from identifier.experiment import estimate_experiment
from identifier.model import to_message
from identifier.model_shelf import ModelShelf
from identifier.request import model_of, settings_of
from identifier.rig_under_test import RigUnderTest, check_against_rig
from identifier.settings import SettingError
from labbus import Bus, Call, FaultError, ServiceConfig

SERVICE = "identifier"

# Shares of the whole query, for its progress: nearly all of the time is the rig's.
_PLAYING_FROM, _PLAYING_TO = 0.02, 0.95


class IdentifierConfig(ServiceConfig):
    """Configuration of the identifier."""

    # Models that identifier/model/<id> can answer; a model of six drives and 1025 lines takes 0.7 MB.
    kept_models: int = Field(default=32, ge=1, le=10_000)


class IdentifierService:
    """Serves identifier/identify and identifier/model/<id>.

    Parameters
    ----------
    bus
        Open.
    config
        Of the service.
    """

    def __init__(self, bus: Bus, config: IdentifierConfig) -> None:
        self._bus = bus
        self._shelf = ModelShelf(config.kept_models)
        self._log = structlog.get_logger(SERVICE)
        bus.serve(bus.keys.identify(), identifier_pb2.IdentifyRequest, self.identify)
        bus.serve(bus.keys.model("*"), identifier_pb2.ModelRequest, self.model)

    def identify(self, request: identifier_pb2.IdentifyRequest, call: Call) -> identifier_pb2.Model:
        """Run an experiment on a rig and answer with the model.

        Parameters
        ----------
        request
            What to play and how to estimate.
        call
            Takes the progress.

        Returns
        -------
        identifier_pb2.Model
            Also held for identifier/model/<id>; empty where the request was only to be checked.

        Raises
        ------
        FaultError
            Where the request is not allowed, the rig is not there, does not play, or cannot be identified.
        """
        log = self._log.bind(run=request.run, rig=request.rig)
        try:
            settings = settings_of(request)
            call.progress("asking the rig what it is", 0.0)
            rig = self._describe(request.rig)
            check_against_rig(settings, rig)
            drive = make_drive(settings, rig)
        except SettingError as error:
            raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field=error.field) from error
        if request.check_only:
            return identifier_pb2.Model()
        log.info("playing", seconds=settings.duration_seconds, drives=len(rig.drives))
        played = self._play(request, rig, drive, call)
        response = _response_of(played, rig, drive.shape[1])
        call.progress("estimating the FRF", _PLAYING_TO)
        try:
            estimate = estimate_experiment(settings, drive=drive, response=response, sample_rate=rig.sample_rate)
        except ValueError as error:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error
        message = to_message(model_of(request, rig=rig, estimate=estimate, played=played))
        self._shelf.put(message)
        log.info("identified", model=message.id, blocks=message.blocks)
        return message

    def model(self, _request: identifier_pb2.ModelRequest, call: Call) -> identifier_pb2.Model:
        """Answer with a model made earlier.

        Parameters
        ----------
        _request
            Empty; the id stands in the key.
        call
            Knows the key.

        Returns
        -------
        identifier_pb2.Model
            As it was made.

        Raises
        ------
        FaultError
            Where it is not held.
        """
        wanted = id_of(call.key)
        message = self._shelf.get(wanted)
        if message is None:
            raise FaultError(
                query_pb2.FAULT_CODE_NOT_FOUND,
                f"The identifier holds no model {wanted!r}; it keeps the {self._shelf.capacity} used last since it was "
                "started, so read older ones from the recording of their campaign.",
            )
        return message

    def _describe(self, rig: str) -> RigUnderTest:
        key = self._bus.keys.rig_description(rig)
        description = self._bus.query(key, rig_pb2.DescriptionRequest(), rig_pb2.RigDescription)
        try:
            return RigUnderTest.from_message(description)
        except ValueError as error:
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error)) from error

    def _play(
        self, request: identifier_pb2.IdentifyRequest, rig: RigUnderTest, drive: np.ndarray, call: Call
    ) -> rig_pb2.PlayResult:
        given_up = threading.Event()
        if call.cancelled:
            raise FaultError(
                query_pb2.FAULT_CODE_CANCELLED, f"Run {request.run!r} was given up before it was played; nothing moved."
            )

        def pass_on(progress: query_pb2.Progress) -> None:
            # The rig keeps sending progress, so this also notices a client that is gone, within a second.
            if call.cancelled:
                given_up.set()
            share = progress.fraction if 0.0 <= progress.fraction <= 1.0 else 0.0
            fraction = _PLAYING_FROM + (_PLAYING_TO - _PLAYING_FROM) * share
            remaining = progress.remaining_seconds if np.isfinite(progress.remaining_seconds) else -1.0
            call.progress(progress.phase, fraction, remaining_seconds=remaining, detail=progress.detail)

        play = rig_pb2.PlayRequest(
            run=request.run, drive=to_record(rig.drives, rig.sample_rate, drive), seed=request.rig_seed
        )
        key = self._bus.keys.rig_play(request.rig)
        return self._bus.query(key, play, rig_pb2.PlayResult, on_progress=pass_on, cancel=given_up)


def _response_of(played: rig_pb2.PlayResult, rig: RigUnderTest, samples: int) -> np.ndarray:
    """Check that a playback answered what was asked."""
    try:
        channels, sample_rate, response = from_record(played.response, field="response")
    except ArrayError as error:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS, f"Rig {rig.name!r} answered a damaged response: {error}"
        ) from error
    names, expected = [c.name for c in channels], [c.name for c in rig.responses]
    if names != expected or sample_rate != rig.sample_rate or response.shape[1] != samples:
        raise FaultError(
            query_pb2.FAULT_CODE_DATA_LOSS,
            f"Rig {rig.name!r} answered {response.shape[1]} samples of {names} at {sample_rate:g} Hz; "
            f"{samples} of {expected} at {rig.sample_rate:g} Hz were expected.",
        )
    return response
