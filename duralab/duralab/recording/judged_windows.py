"""In-band responses of a recording's playbacks, as used for judging, read from its steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from duralab.errors import InputError
from duralab.recording.files import RecordingFiles, input_errors
from duralab_proto.v1 import iterator_pb2
from duralab_recordings import Window, WindowCache, response_in_band, target_of, within_contract


class JudgedWindows:
    """Reader of in-band responses, or their errors, with the interface of `SignalWindows`.

    `file`: Files of the recording. `targets`, each of shape (responses, samples): Target in each control band.
    `sample_rate`: Sample rate in hertz. `levels`: Level of each judged run: iterations and confirmations. `errors`:
    Whether to read target minus response.
    """

    def __init__(
        self,
        file: RecordingFiles,
        *,
        targets: Sequence[np.ndarray],
        sample_rate: float,
        levels: Mapping[str, float],
        errors: bool,
    ) -> None:
        self._file = file
        self._targets = targets
        self._sample_rate = sample_rate
        self._levels = levels
        self._errors = errors
        self._cache = WindowCache()

    def size(self, run: str) -> tuple[int, float]:
        """Return the number of samples of a run, and their rate in hertz."""
        if run not in self._levels:
            raise InputError(
                f"The run {run!r} was not judged, so the recording holds no in-band response of it; it holds "
                f"{', '.join(self._levels) or 'none'}."
            )
        return self._targets[0].shape[1], self._sample_rate

    def read(self, run: str, first: int, last: int) -> Window:
        """Return the samples from `first` to the one before `last` of a run; read-only."""
        samples, _ = self.size(run)
        whole = self._cache.find((run, 0, samples))
        # One pass caches all windows that it reads: runs are mostly read in the order of playing.
        steps = self._steps() if whole is None else iter(())
        while whole is None:
            step = next(steps, None)
            if step is None:
                raise InputError(f"{self._file.path} holds no in-band response of the run {run!r} any more.")
            window = self._window(step)
            self._cache.keep((step.run, 0, samples), window)
            whole = window if step.run == run else None
        return Window(whole.drive, whole.response[:, first:last])

    def _steps(self) -> Iterator[iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep]:
        yield from self._file.messages(iterator_pb2.IterationStep)
        yield from self._file.messages(iterator_pb2.ConfirmationStep)

    def _window(self, step: iterator_pb2.IterationStep | iterator_pb2.ConfirmationStep) -> Window:
        with input_errors(), within_contract(self._file.path):
            target = target_of(step, self._targets)
            response = response_in_band(step, target)
        read = target - response if self._errors else response
        return Window(np.zeros((0, read.shape[1])), read)
