"""Result of a pre-test of a rig, as a table with a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np

from duralab.data.signals import Channel, channels_of
from duralab.display import html_table, text_table
from duralab_proto.arrays import from_array
from duralab_proto.v1 import iterator_pb2

_CHANNELS: Final = ("response", "offset", "noise", "unit", "moved most by", "peak", "lag", "gain", "finding")


@dataclass(frozen=True)
class PreTestFinding:
    """One finding of a pre-test.

    Parameters
    ----------
    check : str
        Name of the check: calibration, noise, offset, saturation, dead, polarity, swapped, cross talk, lag or gain.
    channels : tuple of str
        Names of the affected drives and responses.
    failed : bool
        True for a failure of the pre-test, False for a remark.
    sentence : str
        Problem and remedy.
    """

    check: str
    channels: tuple[str, ...]
    failed: bool
    sentence: str


@dataclass(frozen=True, eq=False)
class PreTest:
    """Result of a pre-test; prints as a table with the findings and the verdict.

    Parameters
    ----------
    id, rig : str
        Id of the recording, and name of the rig.
    passed : bool
        Whether no check failed.
    findings : tuple of PreTestFinding
        Failures and remarks.
    expectations : tuple of str
        References for polarity, order, lag and gain, or notes that a check is missing.
    drives, responses : tuple of Channel
        Channels of the rig, in its order.
    amplitude : np.ndarray, shape (drives)
        Peak of the pulse on each drive, in its unit.
    offset, noise : np.ndarray, shape (responses)
        Mean at rest less the static response, and RMS around the mean, in the unit of the response.
    peak : np.ndarray, shape (responses, drives)
        Largest magnitude of each response during the pulses of each drive, in the unit of the response.
    lag : np.ndarray, shape (responses)
        Lag behind the expected response, or behind the drive that moves it most, in seconds; NaN if unknown.
    gain : np.ndarray, shape (responses)
        Response over the expected response; NaN if there is no expectation.
    """

    id: str
    rig: str
    passed: bool
    findings: tuple[PreTestFinding, ...]
    expectations: tuple[str, ...]
    drives: tuple[Channel, ...]
    responses: tuple[Channel, ...]
    amplitude: np.ndarray
    offset: np.ndarray
    noise: np.ndarray
    peak: np.ndarray
    lag: np.ndarray
    gain: np.ndarray

    @classmethod
    def from_message(cls, message: iterator_pb2.PreTest) -> PreTest:
        """Decode a pre-test."""
        drives, responses = channels_of(message.drives), channels_of(message.responses)
        shapes = {"amplitude": (len(drives),), "peak": (len(responses), len(drives))}
        arrays = {
            name: from_array(
                getattr(message, name), field=name, shape=shapes.get(name, (len(responses),)), finite=False
            )
            for name in ("amplitude", "offset", "noise", "peak", "lag", "gain")
        }
        return cls(
            id=message.id,
            rig=message.rig,
            passed=message.verdict == iterator_pb2.PRE_TEST_VERDICT_PASSED,
            findings=tuple(
                PreTestFinding(
                    check=iterator_pb2.PreTestCheck.Name(one.check)
                    .removeprefix("PRE_TEST_CHECK_")
                    .lower()
                    .replace("_", " "),
                    channels=tuple(one.channels),
                    failed=one.failed,
                    sentence=one.sentence,
                )
                for one in message.findings
            ),
            expectations=tuple(message.expectations),
            drives=drives,
            responses=responses,
            **arrays,
        )

    @property
    def verdict(self) -> str:
        """Verdict as a sentence: passed, or the number of failures."""
        failures = sum(finding.failed for finding in self.findings)
        if self.passed:
            return f"The pre-test of {self.rig} passed; its recording is {self.id}."
        what = "1 failure" if failures == 1 else f"{failures} failures"
        return f"The pre-test of {self.rig} did not pass, with {what}; its recording is {self.id}."

    def __repr__(self) -> str:
        """Return a one-line description without arrays."""
        return f"PreTest({self.rig}: {'passed' if self.passed else 'not passed'}, {self.id})"

    def __str__(self) -> str:
        """Return tables, findings and verdict."""
        cross_talk = (("response", *(drive.name for drive in self.drives)), self._cross_talk())
        return "\n".join(
            [
                text_table(_CHANNELS, self._rows(), left=1),
                "",
                "Peak of each response by drive, % of its largest:",
                text_table(*cross_talk, left=1),
                "",
                *self.expectations,
                *(f"{'✗' if one.failed else '·'} {one.sentence}" for one in self.findings),
                self.verdict,
            ]
        )

    def _repr_html_(self) -> str:
        lines = [*self.expectations, *(one.sentence for one in self.findings)]
        said = "".join(f"<li>{escape(line)}</li>" for line in lines)
        cross_talk = html_table(("response", *(drive.name for drive in self.drives)), self._cross_talk(), left=1)
        table = html_table(_CHANNELS, self._rows(), left=1, caption=self.verdict)
        return f"{table}{cross_talk}<ul>{said}</ul>"

    def _rows(self) -> list[tuple[str, ...]]:
        rows = []
        for row, channel in enumerate(self.responses):
            strongest = int(self.peak[row].argmax())
            checks = dict.fromkeys(one.check for one in self.findings if channel.name in one.channels)
            rows.append(
                (
                    channel.name,
                    f"{self.offset[row]:.3g}",
                    f"{self.noise[row]:.3g}",
                    channel.unit,
                    self.drives[strongest].name,
                    f"{self.peak[row, strongest]:.3g}",
                    "–" if np.isnan(self.lag[row]) else f"{1e3 * self.lag[row]:.1f} ms",
                    "–" if np.isnan(self.gain[row]) else f"{self.gain[row]:.2f}",
                    ", ".join(checks) or "–",
                )
            )
        return rows

    def _cross_talk(self) -> list[tuple[str, ...]]:
        largest = np.maximum(self.peak.max(axis=1, keepdims=True), np.finfo(float).tiny)
        return [
            (channel.name, *(f"{100.0 * share:.0f}" for share in shares))
            for channel, shares in zip(self.responses, self.peak / largest, strict=True)
        ]
