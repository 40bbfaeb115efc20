"""Where exported signals come from: which playback, how good it was, and whether the campaign came to its end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from duralab.campaign import Judgement
from duralab.recording import Recording


@dataclass(frozen=True)
class Origin:
    """What whoever gets the file needs to know of it.

    Parameters
    ----------
    recording : Recording
        Which it was taken from.
    playback : int or None
        The playback that was taken; None for what belongs to no single one.
    """

    recording: Recording
    playback: int | None

    def lines(self) -> Iterator[str]:
        """Yield it in words: the playback, and what is missing."""
        table = self.recording.iterations
        if self.playback is not None:
            row = table.numbers.index(self.playback)
            level = "" if table.level[row] == 1.0 else f", at {table.level[row]:g} of the target"
            yield (
                f"It is playback {self.playback} of {len(table)} in the recording{level}; its relative RMS error over "
                f"all channels is {table.overall[row]:.3f}."
            )
            if row == table.best:
                yield "It is the best playback."
            else:
                yield f"The best is playback {table.numbers[table.best]} with {table.overall[table.best]:.3f}."
        if not self.recording.whole:
            yield f"{self.recording.path} was never finished: what came after its last whole step is not in it."
        judgement = self.recording.verdict.judgement
        if judgement is Judgement.ENDED_EARLY or (self.playback is not None and judgement is not Judgement.REACHED):
            yield self.recording.verdict.sentence

    def document(self) -> dict[str, object]:
        """Return the same for `--json`."""
        table = self.recording.iterations
        row = None if self.playback is None else table.numbers.index(self.playback)
        return {
            "playback": self.playback,
            "overall_error": None if row is None else table.overall[row],
            "level": None if row is None else table.level[row],
            "playbacks": table.numbers,
            "best_playback": table.numbers[table.best] if table.numbers else None,
            "judgement": self.recording.verdict.judgement.value,
            "verdict": self.recording.verdict.sentence,
            "recording_finished": self.recording.whole,
        }
