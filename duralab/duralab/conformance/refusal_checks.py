"""Checks of requests that must be refused before anything moves; each has one error only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy

import numpy as np

from duralab.conformance.bench import Bench, BreachError, NotTriedError, expect
from duralab_bus import FaultError
from duralab_proto.v1 import array_pb2, query_pb2, rig_pb2

#: Largest share of each channel's limits and slew limit in a drive: 5 % pressed the stiff MacPherson axle with 24 kN.
GENTLE = 0.01
_FREQUENCY = 1.0


def gentle_drive(description: rig_pb2.RigDescription, seconds: float) -> np.ndarray:
    """Return a smooth drive that begins and ends at zero, on all channels together."""
    rate = description.sample_rate
    time = np.arange(round(seconds * rate)) / rate
    envelope = np.sin(np.pi * time / seconds) ** 2
    both_ways = envelope * np.sin(2.0 * np.pi * _FREQUENCY * time)
    rows = []
    for channel in description.drives:
        one_sided = channel.minimum == 0.0 or channel.maximum == 0.0
        reach = channel.maximum if channel.maximum > 0.0 else channel.minimum
        size = reach if one_sided else min(channel.maximum, -channel.minimum)
        row = GENTLE * size * (envelope if one_sided else both_ways)
        fastest = float(np.max(np.abs(np.diff(row, prepend=0.0)))) * rate
        if channel.slew_limit > 0.0 and fastest > GENTLE * channel.slew_limit:
            row *= GENTLE * channel.slew_limit / fastest
        rows.append(row)
    return np.array(rows)


def beyond_limit(description: rig_pb2.RigDescription) -> np.ndarray:
    """Return a drive whose first channel goes smoothly to 2 % beyond its maximum, (drives, samples)."""
    channel, rate = description.drives[0], description.sample_rate
    wanted = 1.02 * channel.maximum if channel.maximum > 0.0 else 0.02 * -channel.minimum
    # A raised cosine of height h in T s has the largest slope pi h / (2 T): half the slew limit, or T is 1 s.
    seconds = np.pi * wanted / channel.slew_limit if channel.slew_limit > 0.0 else 1.0
    drive = np.zeros((len(description.drives), max(round(seconds * rate), 10)))
    drive[0] = 0.5 * wanted * (1.0 - np.cos(np.linspace(0.0, np.pi, drive.shape[1])))
    return drive


def jump(description: rig_pb2.RigDescription) -> np.ndarray | None:
    """Return a drive with one step slightly above a slew limit, (drives, samples); None if no channel has one.

    The step is on the first channel on which it stays within 10 % of the channel's maximum.
    """
    rate = description.sample_rate
    for index, channel in enumerate(description.drives):
        step = 1.05 * channel.slew_limit / rate
        if channel.slew_limit > 0.0 and step <= 0.1 * channel.maximum:
            drive = np.zeros((len(description.drives), 100))
            drive[index, 50:] = step
            return drive
    return None


INVALID = query_pb2.FAULT_CODE_INVALID_ARGUMENT
_SAMPLES = 50


def check_refused(
    bench: Bench, play: Callable[[], object], *, run: str, code: query_pb2.FaultCode, field: str, why: str
) -> None:
    """Check that a playback is refused with code, field and sentence, and that no signal block is published."""
    wanted = query_pb2.FaultCode.Name(code)
    try:
        play()
    except FaultError as fault:
        expect(
            fault.code == code,
            f"{why} was refused with {fault.code_name} instead of {wanted}: {fault.message}",
        )
        expect(bool(fault.message.strip()), f"{why} was refused without a sentence.")
        expect(
            fault.field.startswith(field),
            f"{why} was refused with the field {fault.field!r}; it must name {field!r}.",
        )
    else:
        raise BreachError(f"{why} was played; it must be refused with {wanted}.")
    expect(not bench.blocks_of(run), f"{why} was refused, but signal blocks of it were published.")


class RefusalChecks:
    """Checks of bad requests, harmless ones first: a rig that plays one of them gets no jump."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._all_refused = True

    def checks(self) -> dict[str, Callable[[], None]]:
        """Return the check of each bad request, by name, in the order of the checks."""
        description = self._bench.description
        return {
            "refuse.sample_rate": lambda: self._refused(
                why="a drive at twice the sample rate", sample_rate=2.0 * description.sample_rate
            ),
            "refuse.channel_count": self._check_count,
            "refuse.channel_order": self._check_order,
            "refuse.unit": self._check_unit,
            "refuse.not_finite": self._check_finite,
            "refuse.empty": lambda: self._refused(why="an empty drive", drive=self._still()[:, :0]),
            "refuse.run_name": lambda: self._refused(why="a run called 'No Name'", run="No Name", field="run"),
            "refuse.jump": self._check_jump,
            "refuse.limit": self._check_limit,
        }

    def _check_count(self) -> None:
        channels = self._several()[:-1]
        drive = np.zeros((len(channels), _SAMPLES))
        self._refused(why="a drive without its last channel", channels=channels, drive=drive, field="drive.channels")

    def _check_order(self) -> None:
        first, second, *others = self._several()
        swapped = [second, first, *others]
        self._refused(why="a drive with its first two channels swapped", channels=swapped, field="drive.channels")

    def _several(self) -> list[array_pb2.Channel]:
        channels = list(self._bench.description.drives)
        if len(channels) == 1:
            raise NotTriedError("the rig has one drive only.")
        return channels

    def _check_unit(self) -> None:
        channels = deepcopy(list(self._bench.description.drives))
        channels[0].unit = "furlong"
        self._refused(why="a drive in another unit", channels=channels, field="drive.channels")

    def _check_finite(self) -> None:
        drive = self._still()
        drive[0, _SAMPLES // 2] = np.nan
        self._refused(why="a drive with a value that is not a number", drive=drive)

    def _check_limit(self) -> None:
        self._is_safe()
        self._refused(why="a drive beyond a limit", drive=beyond_limit(self._bench.description))

    def _check_jump(self) -> None:
        self._is_safe()
        drive = jump(self._bench.description)
        if drive is None:
            raise NotTriedError("no drive has a slew limit that a small step could exceed.")
        self._refused(why="a drive with a jump", drive=drive)

    def check_twice(self, played: str) -> None:
        """Check that the name of a played run is refused."""
        bench = self._bench
        count = len(bench.blocks_of(played))
        try:
            bench.play(played, self._still())
        except FaultError as fault:
            expect(
                fault.code == query_pb2.FAULT_CODE_ALREADY_EXISTS,
                f"a run name that was played is refused with {fault.code_name} instead of ALREADY_EXISTS.",
            )
        else:
            raise BreachError("a run name that was played is played again; it must be refused with ALREADY_EXISTS.")
        expect(len(bench.blocks_of(played)) == count, "blocks were published for a run name that was refused.")

    def _is_safe(self) -> None:
        if not self._all_refused:
            raise NotTriedError("the rig does not refuse what must be refused, so this would not be safe.")

    def _still(self) -> np.ndarray:
        return np.zeros((len(self._bench.description.drives), _SAMPLES))

    def _refused(
        self,
        *,
        why: str,
        drive: np.ndarray | None = None,
        channels: Sequence[array_pb2.Channel] | None = None,
        sample_rate: float | None = None,
        run: str | None = None,
        field: str = "drive",
    ) -> None:
        bench = self._bench
        name = run or bench.new_run()
        asked = self._still() if drive is None else drive
        # Stays False if the check below raises, i.e. if the request was not properly refused.
        before, self._all_refused = self._all_refused, False
        check_refused(
            bench,
            lambda: bench.play(name, asked, channels=channels, sample_rate=sample_rate),
            run=name,
            code=INVALID,
            field=field,
            why=why,
        )
        self._all_refused = before
