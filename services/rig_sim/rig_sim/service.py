"""The rig simulator on the bus: turns the contract's queries into playbacks. One `RigServer` per rig."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Self

import structlog
from pydantic import model_validator

from duralab_proto.arrays import from_record, to_array, to_record
from duralab_proto.keys import check_run
from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2
from labbus import Bus, Call, ConfigError, FaultError, ServiceConfig, StreamPublisher
from rig_sim.drive_check import DriveError, check_drive
from rig_sim.interlock import Interlock
from rig_sim.player import BLOCK_SAMPLES, Block, Playback, Rig, RigFaultError, load_rig
from rig_sim.specimen import InputChannel, Quantity, SpindleChannel, shipped_specimens

SERVICE = "rig_sim"

_KINDS = {
    Quantity.DISPLACEMENT: array_pb2.CHANNEL_KIND_DISPLACEMENT,
    Quantity.FORCE: array_pb2.CHANNEL_KIND_FORCE,
    Quantity.RATIO: array_pb2.CHANNEL_KIND_RATIO,
    Quantity.VELOCITY: array_pb2.CHANNEL_KIND_VELOCITY,
}
_STATE_SECONDS = 0.5


class RigSimConfig(ServiceConfig):
    """Configuration of the rig simulator."""

    #: Names of shipped rigs to serve.
    rigs: tuple[str, ...] = ("front_axle", "predecessor")
    #: YAML files of further rigs, each with its SDF beside it.
    specimens: tuple[Path, ...] = ()

    @model_validator(mode="after")
    def _serves_something(self) -> Self:
        if not self.rigs and not self.specimens:
            raise ValueError("rigs and specimens are both empty; name at least one rig")
        return self


def load_rigs(config: RigSimConfig) -> dict[str, Rig]:
    """Load all configured rigs.

    Raises
    ------
    ConfigError
        Where a rig is unknown, cannot be used, or two have one name.
    """
    shipped = shipped_specimens()
    unknown = [name for name in config.rigs if name not in shipped]
    if unknown:
        raise ConfigError(f"rigs: {', '.join(unknown)} is not a rig of this simulator; it ships {', '.join(shipped)}.")
    rigs: dict[str, Rig] = {}
    for path in [*(shipped[name] for name in config.rigs), *config.specimens]:
        try:
            rig = load_rig(path)
        except (ValueError, RuntimeError) as error:
            raise ConfigError(f"{path.name}: {error}") from error
        if rig.specimen.name in rigs:
            raise ConfigError(f"rigs: two rigs are called {rig.specimen.name!r}; names must differ.")
        rigs[rig.specimen.name] = rig
    return rigs


class RigServer:
    """Serves one rig: description, play, stop, reset, state and its signal stream."""

    def __init__(self, bus: Bus, rig: Rig) -> None:
        self._bus = bus
        self._rig = rig
        self._name = rig.specimen.name
        self._log = structlog.get_logger(SERVICE).bind(rig=self._name)
        self._interlock = Interlock(self._name)
        self._publishing = threading.Lock()
        keys = bus.keys
        self._states = bus.publisher(keys.rig_state(self._name))
        bus.serve(keys.rig_description(self._name), rig_pb2.DescriptionRequest, self._describe)
        bus.serve(keys.rig_play(self._name), rig_pb2.PlayRequest, self._play)
        # Workers of their own: a stop must be heard while all others are taken.
        bus.serve(keys.rig_stop(self._name), rig_pb2.StopRequest, self._on_stop, workers=4)
        bus.serve(keys.rig_reset(self._name), rig_pb2.ResetRequest, self._on_reset, workers=4)
        bus.serve(keys.rig_state(self._name), rig_pb2.StateRequest, lambda _request, _call: self._interlock.state())

    def close(self) -> None:
        """End a playback that may be under way; nothing plays afterwards."""
        self._interlock.trip("the service ends")

    def _describe(self, _request: rig_pb2.DescriptionRequest, _call: Call) -> rig_pb2.RigDescription:
        specimen = self._rig.specimen
        return rig_pb2.RigDescription(
            rig=self._name,
            specimen=specimen.title,
            engine="compiled",
            version=version("duralab-rig-sim"),
            sample_rate=specimen.sample_rate,
            drives=[_drive_channel(channel) for channel in specimen.drives],
            responses=[_response_channel(channel) for channel in specimen.responses],
            longest_drive_seconds=specimen.longest_drive,
            static_response=to_array(self._rig.static_response),
            block_samples=BLOCK_SAMPLES,
            content_hash=self._rig.content_hash,
        )

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
            publisher = self._bus.publisher(self._bus.keys.rig_signal(self._name, run))
            try:
                return self._perform(request, self._rig.playback(drive, seed=request.seed), publisher, call)
            finally:
                publisher.close()
        finally:
            self._interlock.end()
            self._publish_state()

    def _perform(
        self, request: rig_pb2.PlayRequest, playback: Playback, publisher: StreamPublisher, call: Call
    ) -> rig_pb2.PlayResult:
        run, rate = request.run, self._rig.specimen.sample_rate
        samples = playback.response.shape[1]
        publish = _Publishing(publisher, run, rate)
        clock = _Clock(rate, real_time=request.real_time)
        told = clock.started
        try:
            for block in playback.blocks():
                done = playback.samples_done
                stopped = self._interlock.wait_for_stop(clock.ahead(done))
                publish(block, last=done == samples)
                if done == samples:
                    break
                elapsed = time.monotonic() - clock.started
                self._interlock.fraction = done / samples
                # The bus thins progress out; the state stream goes to everybody.
                remaining = elapsed * (samples - done) / done
                call.progress("playing", done / samples, remaining_seconds=remaining, detail=run)
                if clock.started + elapsed - told >= _STATE_SECONDS:
                    told = clock.started + elapsed
                    self._publish_state()
                if stopped or call.cancelled:
                    self._ramp_down(playback, publish, clock)
                    why = self._interlock.state().reason if stopped else "its commander is gone"
                    self._log.warning("ramped down", run=run, reason=why)
                    raise FaultError(query_pb2.FAULT_CODE_CANCELLED, f"run {run!r} was stopped: {why}.")
        except RigFaultError as error:
            self._log.warning("broken off", run=run, reason=str(error))
            raise FaultError(query_pb2.FAULT_CODE_FAILED_PRECONDITION, str(error), field="drive.samples") from error
        factor = samples / rate / (time.monotonic() - clock.started)
        self._log.info("played", run=run, seconds=samples / rate, real_time_factor=factor)
        return rig_pb2.PlayResult(
            run=run,
            response=to_record([_response_channel(c) for c in self._rig.specimen.responses], rate, playback.response),
            actuators=[
                rig_pb2.ActuatorUse(
                    drive=use.drive,
                    peak_command_ratio=use.peak_command_ratio,
                    saturated_share=use.saturated_share,
                    largest_following_error=use.largest_following_error,
                )
                for use in playback.uses()
            ],
            epoch=publisher.epoch,
            blocks=publish.blocks,
            real_time_factor=factor,
        )

    @staticmethod
    def _ramp_down(playback: Playback, publish: _Publishing, clock: _Clock) -> None:
        ramp = list(playback.ramp_down())
        for block in ramp:
            time.sleep(clock.ahead(block.first_sample + block.drive.shape[1]))
            publish(block, last=block is ramp[-1])

    def _on_stop(self, request: rig_pb2.StopRequest, _call: Call) -> rig_pb2.RigState:
        self._interlock.trip(request.reason)
        # Everybody hears of the stop now, and of the rest afterwards.
        self._publish_state()
        self._log.warning("stopped", reason=self._interlock.state().reason)
        return self._interlock.wait_for_rest()

    def _on_reset(self, _request: rig_pb2.ResetRequest, _call: Call) -> rig_pb2.RigState:
        if self._interlock.state().mode == rig_pb2.RIG_MODE_INTERLOCKED:
            # A latch is not cleared over a rig that is still on its way down.
            self._interlock.wait_for_rest()
            self._interlock.reset()
            self._publish_state()
            self._log.info("reset")
        return self._interlock.state()

    def _publish_state(self) -> None:
        # Reading and sending in one piece: else a state could overtake the one that followed it.
        with self._publishing:
            self._states.put(self._interlock.state())


class _Publishing:
    """Publishes the blocks of one run and counts them."""

    def __init__(self, publisher: StreamPublisher, run: str, rate: float) -> None:
        self._publisher = publisher
        self._run = run
        self._rate = rate
        self.blocks = 0

    def __call__(self, block: Block, *, last: bool) -> None:
        self._publisher.put(_signal_block(self._run, self._rate, block, last=last))
        self.blocks += 1


class _Clock:
    """Says how far a playback is ahead of real time, where it has to keep to it."""

    def __init__(self, rate: float, *, real_time: bool) -> None:
        self._rate = rate
        self._real_time = real_time
        self.started = time.monotonic()

    def ahead(self, samples: int) -> float:
        """Return for how many seconds to wait after so many samples."""
        if not self._real_time:
            return 0.0
        return max(samples / self._rate - (time.monotonic() - self.started), 0.0)


def _signal_block(run: str, rate: float, block: Block, *, last: bool) -> rig_pb2.SignalBlock:
    return rig_pb2.SignalBlock(
        run=run,
        first_sample=block.first_sample,
        sample_rate=rate,
        drive=to_array(block.drive),
        response=to_array(block.response),
        last=last,
    )


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


def _response_channel(channel: SpindleChannel) -> array_pb2.Channel:
    return array_pb2.Channel(
        name=channel.name,
        unit="N",
        kind=array_pb2.CHANNEL_KIND_FORCE,
        minimum=-channel.range,
        maximum=channel.range,
        label=channel.label,
    )


@contextmanager
def serve(bus: Bus, config: RigSimConfig) -> Iterator[list[RigServer]]:
    """Load the configured rigs, serve them on the bus and declare each live, until the block ends."""
    servers = {name: RigServer(bus, rig) for name, rig in load_rigs(config).items()}
    # Last: whoever sees a rig may ask it.
    for name in servers:
        bus.declare_live(SERVICE, name)
    try:
        yield list(servers.values())
    finally:
        for server in servers.values():
            server.close()
