"""A rig in an FMU that plays: each playback in a new process, so that no run affects the next one."""

from __future__ import annotations

import shutil
import tempfile
import weakref
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from duralab_gateway.motion import Block, RigFaultError, Use, Watchdog, when
from rig_sim.fmu.model_description import FmuModel, read_model
from rig_sim.fmu.process import FmuError, FmuProcess
from rig_sim.fmu.specimen import FmuDrive, FmuSpecimen
from rig_sim.playing import (
    BLOCK_SAMPLES,
    Fault,
    SensorFault,
    SimulatedPlayback,
    content_hash,
    sensor_faults,
    title_suffix,
)
from rig_sim.specimen import SpecimenError, document_files, read_specimen

#: Length and size of the drive that is played twice when a rig is loaded.
_TRIED_SECONDS, _TRIED_SHARE = 0.5, 0.01


class UnpackedFmu:
    """Folder with the files of an FMU, which is removed with this object."""

    def __init__(self, file: Path) -> None:
        self.folder = tempfile.mkdtemp(prefix="duralab_fmu_")
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        with zipfile.ZipFile(file) as archive:
            archive.extractall(self.folder)


@dataclass(frozen=True)
class FmuRig:
    """An FMU ready to play; made by `load_fmu_rig`."""

    specimen: FmuSpecimen
    model: FmuModel
    unpacked: UnpackedFmu
    static_response: np.ndarray
    content_hash: str
    watchdogs: tuple[Watchdog, ...] = ()
    faults: tuple[SensorFault, ...] = ()

    @property
    def engine_name(self) -> str:
        """Name of the engine that plays."""
        return f"FMI {self.model.fmi}.0 co-simulation"

    @property
    def block_samples(self) -> int:
        """Number of samples in every block of a playback except the last."""
        return BLOCK_SAMPLES

    def playback(self, drive: np.ndarray, *, seed: int) -> FmuPlayback:
        """Return a playback of a checked drive (drives, samples) that has not begun yet."""
        return FmuPlayback(self, drive, seed=seed)


def load_fmu_rig(path: Path, faults: Sequence[Fault] = ()) -> FmuRig:
    """Load a rig in an FMU from its YAML, with faults of its sensors, and play a short drive on it twice.

    If the two responses differ, the rig's title states it. Raises `SpecimenError` if it cannot be used.
    """
    whole = read_specimen(path, FmuSpecimen)
    broken = sensor_faults(faults, rig=whole.name, channels=[channel.name for channel in whole.responses])
    file = path.with_name(whole.fmu)
    if not file.is_file():
        raise SpecimenError(f"specimen {whole.name}: {file.name} does not lie beside {path.name}.")
    model = read_model(file, whole)
    watchdogs = whole.set_up_watchdogs()
    try:
        unpacked = UnpackedFmu(file)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise SpecimenError(f"specimen {whole.name}: {file.name} cannot be unpacked: {reason}.") from error
    try:
        digest = content_hash((file, *document_files(path)), faults, engine="fmu\n")
        first, second = _played_twice(whole, model, unpacked.folder)
    except (FmuError, OSError) as error:
        raise SpecimenError(f"specimen {whole.name}: {file.name} {error}.") from error
    title = whole.title + _difference(whole, first, second) + title_suffix(faults)
    specimen = whole.model_copy(update={"title": title})
    return FmuRig(specimen, model, unpacked, first[:, 0].copy(), digest, watchdogs, broken)


def _played_twice(specimen: FmuSpecimen, model: FmuModel, folder: str) -> list[np.ndarray]:
    """Play a short smooth pulse on all drives together, in two processes side by side."""
    samples = max(round(_TRIED_SECONDS * specimen.sample_rate), 2)
    pulse = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(samples + 1) / samples))
    heights = [_tried_height(channel) for channel in specimen.drives]
    processes = [FmuProcess(specimen, model, folder) for _ in range(2)]
    try:
        return [process.play(np.outer(heights, pulse), 0) for process in processes]
    finally:
        for process in processes:
            process.end()


def _tried_height(channel: FmuDrive) -> float:
    end = channel.maximum if channel.maximum > 0.0 else channel.minimum
    # The steepest slope of the pulse is pi times its height over its length.
    gentle = channel.slew_limit * _TRIED_SECONDS / np.pi if channel.slew_limit > 0.0 else np.inf
    return float(np.copysign(min(_TRIED_SHARE * abs(end), gentle), end))


def _difference(specimen: FmuSpecimen, first: np.ndarray, second: np.ndarray) -> str:
    """Return the title's remark on an FMU with two responses to one drive; empty if they are equal."""
    if first.tobytes() == second.tobytes():
        return ""
    row, sample = np.unravel_index(np.argmax(np.abs(first - second)), first.shape)
    channel = specimen.responses[row]
    return (
        f" [NOT REPEATABLE: {channel.name} differed by {abs(first[row, sample] - second[row, sample]):.2g} "
        f"{channel.unit} between two runs of one drive]"
    )


class FmuPlayback(SimulatedPlayback):
    """A playback of an FMU, whose process begins with its first block and ends with it; read `uses()` at its end."""

    def __init__(self, rig: FmuRig, drive: np.ndarray, *, seed: int) -> None:
        super().__init__(rig.specimen, drive, seed=seed, faults=rig.faults, block_samples=rig.block_samples)
        self._rig = rig
        self._process: FmuProcess | None = None
        self._end: Callable[[], object] = lambda: None

    def uses(self) -> list[Use]:
        """Return the peak of every drive so far: the use of its actuator is inside the FMU."""
        ratios = zip(self._rig.specimen.drives, self.peak_ratios(), strict=True)
        return [Use(channel.name, ratio, 0.0, 0.0) for channel, ratio in ratios]

    def _advance(self, commands: np.ndarray, first: int, *, counted: bool) -> Block:
        del counted
        rig = self._rig
        try:
            if self._process is None:
                self._process = FmuProcess(rig.specimen, rig.model, rig.unpacked.folder)
                self._end = weakref.finalize(self, self._process.end)
            measured = self._process.play(commands, first)
        except (FmuError, OSError) as error:
            self._end()
            seconds = first / rig.specimen.sample_rate
            raise RigFaultError(
                f"{rig.specimen.fmu} {error}, in the block that began {when(seconds)}; see to the FMU and reset "
                f"{rig.specimen.name}, the next run begins a new process."
            ) from error
        drive = commands[:, :-1]
        return Block(
            first_sample=first,
            drive=drive,
            response=self._sensed(first, measured),
            following_error=np.zeros(drive.shape),
            monitored=np.empty((0, drive.shape[1])),
        )
