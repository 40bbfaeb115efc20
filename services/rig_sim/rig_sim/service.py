"""The rig simulator on the bus: turns the contract's queries into playbacks. One `RigServer` per rig."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Final, NoReturn, Self

import structlog
from pydantic import Field, model_validator

from duralab_proto.arrays import from_record, to_array
from duralab_proto.keys import KeyNameError, check_run
from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2
from labbus import Bus, Call, ConfigError, FaultError, Metrics, ServiceConfig, SpoolFolder, SpoolFullError, SpoolSpace
from rig_sim.bus import Interlock, PlaybackSession, answer_frf, describe_view, published_samples
from rig_sim.engines import EngineChoice
from rig_sim.loading import load_any_rig, rigs_by_name
from rig_sim.playing import DriveError, Fault, PlayableRig, PlayableSpecimen, Rig, check_drive
from rig_sim.specimen import InputChannel, Quantity, SpecimenError, shipped_specimens

SERVICE = "rig_sim"

#: Label of a rig's metrics.
_RIG: Final = ("rig",)

_KINDS = {
    Quantity.ACCELERATION: array_pb2.CHANNEL_KIND_ACCELERATION,
    Quantity.DISPLACEMENT: array_pb2.CHANNEL_KIND_DISPLACEMENT,
    Quantity.FORCE: array_pb2.CHANNEL_KIND_FORCE,
    Quantity.MOMENT: array_pb2.CHANNEL_KIND_MOMENT,
    Quantity.RATIO: array_pb2.CHANNEL_KIND_RATIO,
    Quantity.VELOCITY: array_pb2.CHANNEL_KIND_VELOCITY,
}


class RigSimConfig(ServiceConfig):
    """Configuration of the rig simulator."""

    #: Names of shipped rigs to serve.
    rigs: tuple[str, ...] = ("front_axle", "predecessor")
    #: YAML files of further rigs, each with its SDF beside it.
    specimens: tuple[Path, ...] = ()
    #: Faults to inject, by the rig's name, for tests and rehearsals.
    faults: dict[str, tuple[Fault, ...]] = Field(default_factory=dict)
    #: What integrates a rig, by the rig's name; the compiled player where nothing is said.
    engines: dict[str, EngineChoice] = Field(default_factory=dict)
    #: Play every drive in real time, whatever its request says: a rehearsal of a real rig. The responses are the same.
    real_time: bool = False
    #: Where signal blocks lie on disk until the recorder has stored them, so that they survive this process; in memory
    #: where not given.
    spool_folder: Path | None = None
    #: Bound of all of it, in bytes.
    spool_bytes: int = Field(default=512 * 2**20, ge=16 * 2**20)
    #: How long a simulation waits for the recorder where there is no more room, in s, before it ramps down. A rig that
    #: plays in real time cannot wait.
    spool_wait_seconds: float = Field(default=30.0, ge=0.0, le=3600.0)

    @model_validator(mode="after")
    def _serves_something(self) -> Self:
        if not self.rigs and not self.specimens:
            raise ValueError("rigs and specimens are both empty; name at least one rig")
        return self


def find_rigs(config: RigSimConfig) -> dict[str, Path]:
    """Return the YAMLs of all configured rigs by the rigs' names.

    Raises
    ------
    ConfigError
        Where a rig is unknown, a file is not there, two rigs have one name, or an engine or a fault is for none.
    """
    shipped = shipped_specimens()
    unknown = [name for name in config.rigs if name not in shipped]
    if unknown:
        raise ConfigError(f"rigs: {', '.join(unknown)} is not a rig of this simulator; it ships {', '.join(shipped)}.")
    try:
        rigs = rigs_by_name([*(shipped[name] for name in config.rigs), *config.specimens])
    except SpecimenError as error:
        raise ConfigError(f"rigs: {error}") from error
    for what, names in (("engines", config.engines), ("faults", config.faults)):
        idle = [name for name in names if name not in rigs]
        if idle:
            raise ConfigError(f"{what}: {', '.join(idle)} is not a rig served here; those are {', '.join(rigs)}.")
    return rigs


class RigMetrics:
    """Metrics of a rig: is it latched, does it play, how fast, and how often its playbacks ended.

    Parameters
    ----------
    metrics : Metrics
        Of the process.
    rig : str
        Its name.
    state : callable
        Returns its state now.
    """

    def __init__(self, metrics: Metrics, rig: str, state: Callable[[], rig_pb2.RigState]) -> None:
        self._rig = rig
        self._factor: dict[tuple[str, ...], float] = {}
        self._playbacks = metrics.count(
            "duralab_rig_playbacks_total", "Playbacks that ended, by rig and code", labels=("rig", "code")
        )
        self._seconds = metrics.count(
            "duralab_rig_played_seconds_total", "Length of the drives played to their end", labels=_RIG
        )
        readings: tuple[tuple[str, str, Callable[[rig_pb2.RigState], float]], ...] = (
            ("interlocked", "1 while the rig is latched", lambda now: now.mode == rig_pb2.RIG_MODE_INTERLOCKED),
            ("playing", "1 while a run moves the rig", lambda now: now.run != ""),
            ("run_fraction", "Share of the run that is played", lambda now: now.fraction),
        )
        for name, what, read in readings:
            metrics.follow(f"duralab_rig_{name}", what, lambda read=read: {(rig,): float(read(state()))}, labels=_RIG)
        metrics.follow(
            "duralab_rig_real_time_factor", "Seconds of drive a second, of the last playback", self._read, labels=_RIG
        )

    def played(self, result: rig_pb2.PlayResult, *, seconds: float) -> None:
        """Count a playback that came to its end."""
        self._playbacks.add(self._rig, "OK")
        self._seconds.add(self._rig, amount=seconds)
        self._factor = {(self._rig,): result.real_time_factor}

    def broken_off(self, code: str) -> None:
        """Count one that did not, with the fault's code."""
        self._playbacks.add(self._rig, code)

    def _read(self) -> Mapping[tuple[str, ...], float]:
        return self._factor


class RigServer:
    """Serves one rig: description, play, stop, reset, state and its signal stream."""

    def __init__(
        self, bus: Bus, rig: PlayableRig, spools: SpoolSpace, *, spool_wait_seconds: float, real_time: bool = False
    ) -> None:
        self._bus = bus
        self._rig = rig
        self._real_time = real_time
        self._name = rig.specimen.name
        self._log = structlog.get_logger(SERVICE).bind(rig=self._name)
        self._interlock = Interlock(self._name)
        self._metrics = RigMetrics(bus.metrics, self._name, self._interlock.state)
        self._publishing = threading.Lock()
        keys = bus.keys
        self._states = bus.publisher(keys.rig_state(self._name))
        self._session = PlaybackSession(
            bus,
            rig,
            self._interlock,
            responses=_response_channels(rig.specimen),
            report_state=self._publish_state,
            spools=spools,
            spool_wait_seconds=spool_wait_seconds,
        )
        bus.serve(keys.rig_description(self._name), rig_pb2.DescriptionRequest, self._describe)
        bus.serve(keys.rig_frf(self._name), rig_pb2.RigFrfRequest, lambda request, _call: answer_frf(rig, request))
        # Workers of their own: rigs beside each other play at once, one more query is told that this one is busy, and a
        # stop is heard while all others are taken.
        bus.serve(keys.rig_play(self._name), rig_pb2.PlayRequest, self._play, workers=2)
        bus.serve(keys.rig_stop(self._name), rig_pb2.StopRequest, self._on_stop, workers=4)
        bus.serve(keys.rig_reset(self._name), rig_pb2.ResetRequest, self._on_reset, workers=4)
        bus.serve(keys.rig_state(self._name), rig_pb2.StateRequest, lambda _request, _call: self._interlock.state())

    def close(self) -> None:
        """End a playback that may be under way; nothing plays afterwards."""
        self._interlock.trip("the service ends")

    def _describe(self, _request: rig_pb2.DescriptionRequest, _call: Call) -> rig_pb2.RigDescription:
        specimen = self._rig.specimen
        description = rig_pb2.RigDescription(
            rig=self._name,
            specimen=specimen.title,
            engine=self._rig.engine_name,
            version=version("duralab-rig-sim"),
            sample_rate=specimen.sample_rate,
            drives=[_drive_channel(channel) for channel in specimen.drives],
            responses=_response_channels(specimen),
            longest_drive_seconds=specimen.longest_drive,
            static_response=to_array(self._rig.static_response),
            block_samples=published_samples(self._rig),
            content_hash=self._rig.content_hash,
        )
        if isinstance(self._rig, Rig):
            describe_view(self._rig, description)
        return description

    def _play(self, request: rig_pb2.PlayRequest, call: Call) -> rig_pb2.PlayResult:
        try:
            run = check_run(request.run)
        except ValueError as error:
            raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field="run") from error
        channels, sample_rate, drive = from_record(request.drive, field="drive")
        names, units = [channel.name for channel in channels], [channel.unit for channel in channels]
        try:
            check_drive(self._rig.specimen, names, units, sample_rate, drive)
        except DriveError as error:
            raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field=error.field) from error
        self._interlock.begin(run)
        try:
            self._publish_state()
            real_time = self._real_time or request.real_time
            result = self._session.play(request, drive, call, real_time=real_time)
            self._metrics.played(result, seconds=drive.shape[1] / sample_rate)
            return result
        except FaultError as fault:
            self._metrics.broken_off(fault.code_name)
            raise
        finally:
            self._interlock.end()
            self._publish_state()

    def stop(self, reason: str) -> None:
        """Latch, and tell what plays to ramp down; does not wait for it."""
        self._interlock.trip(reason)
        # Everybody hears of the stop now, and of the rest afterwards.
        self._publish_state()
        self._log.warning("stopped", reason=self._interlock.state().reason)

    def _on_stop(self, request: rig_pb2.StopRequest, _call: Call) -> rig_pb2.RigState:
        self.stop(request.reason)
        return self._interlock.wait_for_rest()

    def _on_reset(self, request: rig_pb2.ResetRequest, _call: Call) -> rig_pb2.RigState:
        seen = self._interlock.trips
        if request.command:
            # Whatever it finds: an old command must not clear a latch that is set later.
            try:
                self._interlock.claim(check_run(request.command))
            except KeyNameError as error:
                raise FaultError(query_pb2.FAULT_CODE_INVALID_ARGUMENT, str(error), field="command") from error
        if self._interlock.state().mode == rig_pb2.RIG_MODE_INTERLOCKED:
            # A latch is not cleared over a rig that is still on its way down, nor one that is set meanwhile.
            self._interlock.wait_for_rest()
            self._interlock.reset(seen=seen)
            self._publish_state()
            self._log.info("reset")
        return self._interlock.state()

    def _publish_state(self) -> None:
        # Reading and sending in one piece: else a state could overtake the one that followed it.
        with self._publishing:
            try:
                self._states.put(self._interlock.state())
            except SpoolFullError as error:
                # Whoever asks is told; and no stop may fail because nobody stores that it came.
                self._log.warning("a state is not published", reason=str(error))


def _drive_channel(channel: InputChannel) -> array_pb2.Channel:
    return array_pb2.Channel(
        name=channel.name,
        unit=channel.unit,
        kind=_KINDS[channel.quantity],
        minimum=channel.minimum,
        maximum=channel.maximum,
        slew_limit=channel.slew_limit,
        label=channel.label,
    )


def _response_channels(specimen: PlayableSpecimen) -> list[array_pb2.Channel]:
    return [
        array_pb2.Channel(
            name=channel.name,
            unit=channel.unit,
            kind=_KINDS[channel.quantity],
            minimum=-channel.range,
            maximum=channel.range,
            label=channel.label,
            watchdog=specimen.watchdogs.responses.get(channel.name, 0.0),
        )
        for channel in specimen.responses
    ]


@contextmanager
def serve(bus: Bus, config: RigSimConfig) -> Iterator[list[RigServer]]:
    """Load the configured rigs, each served and declared live as soon as it is ready, until the block ends.

    A rig that cannot be used keeps no other from being served: its queries are answered with the reason.

    Raises
    ------
    ConfigError
        Where no rig can be used; with the reason of each.
    """
    log = structlog.get_logger(SERVICE)
    servers: list[RigServer] = []
    refused: dict[str, str] = {}
    spools = _open_spools(bus, config)
    try:
        for name, path in find_rigs(config).items():
            try:
                rig = load_any_rig(path, config.engines, config.faults)
            except (ValueError, RuntimeError, ArithmeticError, LookupError) as error:
                refused[name] = str(error)
                continue
            servers.append(
                RigServer(bus, rig, spools, spool_wait_seconds=config.spool_wait_seconds, real_time=config.real_time)
            )
            # Last: whoever sees a rig may ask it.
            bus.declare_live(SERVICE, name)
        if not servers:
            raise ConfigError(" ".join(refused.values()))
        for name, reason in refused.items():
            log.error("refused", rig=name, reason=reason)
            _serve_refusal(bus, name, reason)
            bus.declare_live(SERVICE, name)
        yield servers
    finally:
        for server in servers:
            server.close()


def _serve_refusal(bus: Bus, rig: str, reason: str) -> None:
    """Answer every query of a rig with the fault FAILED_PRECONDITION.

    Parameters
    ----------
    bus : Bus
        Where it would have been served.
    rig : str
        Its name.
    reason : str
        Why it cannot be used, one sentence.
    """

    def refuse(_request: object, _call: Call) -> NoReturn:
        raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, f"{rig} cannot be used: {reason}")

    keys = bus.keys
    for key, request in (
        (keys.rig_description(rig), rig_pb2.DescriptionRequest),
        (keys.rig_frf(rig), rig_pb2.RigFrfRequest),
        (keys.rig_play(rig), rig_pb2.PlayRequest),
        (keys.rig_stop(rig), rig_pb2.StopRequest),
        (keys.rig_reset(rig), rig_pb2.ResetRequest),
        (keys.rig_state(rig), rig_pb2.StateRequest),
    ):
        bus.serve(key, request, refuse)


def _open_spools(bus: Bus, config: RigSimConfig) -> SpoolSpace:
    """Return where signal blocks are kept; what a killed predecessor left there is offered to the recorder."""
    if config.spool_folder is None:
        return SpoolSpace(config.spool_bytes)
    spools = SpoolFolder(config.spool_folder, largest_bytes=config.spool_bytes)
    if left := bus.serve_left_spools(spools):
        structlog.get_logger(SERVICE).warning("streams of a rig that was killed are served again", streams=left)
    return spools
