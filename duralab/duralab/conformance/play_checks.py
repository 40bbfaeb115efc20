"""Checks of a short playback: result, signal blocks, progress, state stream."""

from __future__ import annotations

import threading
import time

import numpy as np

from duralab.conformance.bench import REPAIR_SECONDS, Bench, NotTriedError, check_numbering, expect
from duralab.conformance.refusal_checks import gentle_drive
from duralab_proto.arrays import from_array, from_record
from duralab_proto.v1 import query_pb2, rig_pb2

#: Limit of the contract, 1 s, and a margin for the bus.
LONGEST_SILENCE_SECONDS = 1.5
PULSE_SECONDS = 0.05


class Pulse:
    """Measurement of pauses of this process, which must not count as silence of a rig."""

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="pulse", daemon=True)
        self.longest_pause = 0.0

    def __enter__(self) -> Pulse:
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._ended.set()
        self._thread.join()

    def _beat(self) -> None:
        before = time.monotonic()
        while not self._ended.wait(PULSE_SECONDS):
            now = time.monotonic()
            self.longest_pause = max(self.longest_pause, now - before - PULSE_SECONDS)
            before = now


class PlayChecks:
    """Checks of one playback in real time."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._run = bench.new_run()
        self._drive = np.zeros((0, 0))
        self._result = rig_pb2.PlayResult()
        self._fractions: list[float] = []
        self._silence = 0.0
        self._pause = 0.0
        self._played = False

    def check_plays(self) -> None:
        """Check that the rig plays a gentle drive and returns the same number of finite response samples."""
        bench, description = self._bench, self._bench.description
        self._drive = gentle_drive(description, bench.seconds)
        heard = time.monotonic()

        def on_progress(progress: query_pb2.Progress) -> None:
            nonlocal heard
            now = time.monotonic()
            self._silence, heard = max(self._silence, now - heard), now
            self._fractions.append(progress.fraction)

        began = heard
        with Pulse() as pulse:
            self._result = bench.play(self._run, self._drive, real_time=True, on_progress=on_progress)
        self._pause = pulse.longest_pause
        took = time.monotonic() - began
        self._silence = max(self._silence, time.monotonic() - heard)
        self._played = True
        result = self._result
        expect(result.run == self._run, f"the result is of run {result.run!r}; played was {self._run!r}.")
        channels, rate, response = from_record(result.response, field="response")
        names = [channel.name for channel in channels]
        expect(
            names == [channel.name for channel in description.responses],
            f"the response has the channels {', '.join(names)}; the description has others, or another order.",
        )
        expect(
            rate == description.sample_rate,
            f"the response is at {rate:g} Hz; the description says {description.sample_rate:g}.",
        )
        expect(
            response.shape[1] == self._drive.shape[1],
            f"the response has {response.shape[1]} samples; the drive had {self._drive.shape[1]}.",
        )
        expect(
            [use.drive for use in result.actuators] == [channel.name for channel in description.drives],
            "the result does not tell the use of every actuator, in the order of the drives.",
        )
        expect(result.real_time_factor > 0.0, f"real_time_factor is {result.real_time_factor:g}; it is above 0.")
        expect(
            took >= 0.9 * bench.seconds,
            f"{bench.seconds:g} s were played in {took:.2f} s although real time was asked for.",
        )

    def check_stream(self) -> None:
        """Check that the signal blocks are complete, and equal to the drive and the result."""
        self._need()
        bench, result = self._bench, self._result

        def lost() -> int:
            return bench.lost_blocks(self._run, result.epoch)

        bench.wait(lambda: lost() > 0 or len(bench.blocks_of(self._run)) >= max(result.blocks, 1), REPAIR_SECONDS)
        items = bench.blocks_of(self._run)
        gone = (
            f" On the way here {count} were lost that the rig keeps no longer, as it may once a recorder has them; "
            "where one runs, check again without it."
            if (count := lost())
            else ""
        )
        expect(
            len(items) == result.blocks > 0,
            f"{len(items)} signal blocks came; the result says {result.blocks}, and it takes at least one.{gone}",
        )
        check_signal(bench, self._run, epoch=result.epoch)
        drive = np.hstack([from_array(item.message.drive) for item in items])
        expect(
            drive.shape == self._drive.shape and np.array_equal(drive, self._drive),
            "the drive in the signal blocks is not the one that was asked for.",
        )
        _, _, response = from_record(result.response, field="response")
        streamed = np.hstack([from_array(item.message.response) for item in items])
        expect(
            streamed.shape == response.shape and np.array_equal(streamed, response),
            "the response in the signal blocks is not the one in the result.",
        )

    def check_progress(self) -> None:
        """Check that the rig reports progress at least every second."""
        self._need()
        expect(
            bool(self._fractions) or self._bench.seconds < 1.0,
            f"no progress came in {self._bench.seconds:g} s; it is due every second.",
        )
        expect(
            self._silence <= LONGEST_SILENCE_SECONDS + self._pause,
            f"no progress came for {self._silence:.2f} s; it is due every second.",
        )
        expect(
            self._fractions == sorted(self._fractions) and all(0.0 <= f <= 1.0 for f in self._fractions),
            "the fraction in the progress went down, or left 0 to 1.",
        )

    def check_state(self) -> None:
        """Check that the state stream reports the run as playing, and then idle."""
        self._need()
        bench = self._bench
        playing, idle = (rig_pb2.RIG_MODE_PLAYING, self._run), (rig_pb2.RIG_MODE_IDLE, "")

        def went_idle() -> bool:
            modes = bench.modes()
            return playing in modes and idle in modes[modes.index(playing) :]

        bench.wait(went_idle)
        expect(playing in bench.modes(), "the state stream never said that it plays the run.")
        expect(went_idle(), "the state stream never said that it is idle again after the run.")

    def check_poses(self) -> None:
        """Check that the pose stream has all bodies, unit quaternions, and no more than 60 poses a second."""
        self._need()
        bench, bodies = self._bench, len(self._bench.description.bodies)
        if bodies == 0:
            raise NotTriedError("the description has no bodies, so there is no pose stream.")

        def mine() -> list[rig_pb2.PoseBlock]:
            return [item.message for item in list(bench.poses) if item.message.run == self._run]

        bench.wait(lambda: bool(mine()))
        expect(bool(mine()), "the description has bodies, but no pose came while it played.")
        check_numbering(list(bench.poses), "pose stream")
        times = np.concatenate([from_array(block.time, field="time", shape=(None,)) for block in mine()])
        poses = np.concatenate([from_array(b.poses, field="poses", shape=(None, bodies, 7)) for b in mine()])
        expect(len(times) == len(poses), f"{len(poses)} poses came with {len(times)} times.")
        expect(
            bool(np.all(np.diff(times) >= 1.0 / 60.0 - 1.0e-9)),
            "poses come more often than 60 times a second of the run, or out of order.",
        )
        lengths = np.linalg.norm(poses[:, :, 3:], axis=2)
        expect(bool(np.all(np.abs(lengths - 1.0) < 1.0e-6)), "a quaternion of the pose stream is not of length 1.")

    @property
    def played_run(self) -> str:
        """Name of the run that was played to its end."""
        self._need()
        return self._run

    def _need(self) -> None:
        if not self._played:
            raise NotTriedError("nothing was played to its end.")


def check_signal(bench: Bench, run: str, *, epoch: int | None) -> None:
    """Check the blocks of an ended run, with any drive."""
    items = bench.blocks_of(run)
    description = bench.description
    expect(bool(items), "no signal block came.")
    expect(items[0].seq == 0, f"the first signal block has the number {items[0].seq}; numbers of a run begin at 0.")
    check_numbering(items, "signal stream")
    if epoch is not None:
        expect(items[0].epoch == epoch, f"the signal blocks have epoch {items[0].epoch}; the result says {epoch}.")
    due = 0
    for item in items:
        block = item.message
        expect(block.run == run, f"a block of run {block.run!r} came on the key of {run!r}.")
        expect(
            block.first_sample == due,
            f"a signal block begins at sample {block.first_sample}; {due} is due, without a gap.",
        )
        expect(
            block.sample_rate == description.sample_rate,
            f"a signal block is at {block.sample_rate:g} Hz; the description says {description.sample_rate:g}.",
        )
        drive = from_array(block.drive, field="drive", shape=(len(description.drives), None))
        response = from_array(block.response, field="response", shape=(len(description.responses), None))
        samples = drive.shape[1]
        expect(
            response.shape[1] == samples,
            f"a signal block has {samples} samples of the drive and {response.shape[1]} of the response.",
        )
        expect(
            0 < samples <= description.block_samples,
            f"a signal block has {samples} samples; the description says {description.block_samples} at most.",
        )
        due += samples
    marks = [item.message.last for item in items]
    expect(marks == [False] * (len(marks) - 1) + [True], "`last` is not set in the final signal block, and only there.")
