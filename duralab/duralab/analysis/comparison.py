"""Comparison of recorded campaigns: verdicts, numbers channel by channel, and differing settings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, runtime_checkable

from duralab.analysis.setting_differences import SettingDifference, differing_settings
from duralab.campaign import Verdict
from duralab.data import DAMAGE_SLOPES, IterationTable, passes
from duralab.errors import InputError
from duralab.recording import Recording, open_recording

if TYPE_CHECKING:
    import xarray

_BY_SLOPE: Final = ("damage_ratio", "identification_damage", "damage_spent")
_SPENT: Final = "damage spent on the specimen (of it by the identification), passes of the target, k = 5"
_ERRORS: Final = "relative RMS error after the best playback, 0 is perfect"


@runtime_checkable
class Recorded(Protocol):
    """Object with a recording, such as a `CampaignResult`."""

    @property
    def recording(self) -> Recording:
        """The recording."""
        ...


@dataclass(frozen=True, eq=False)
class ComparedRecording:
    """Recording in a comparison.

    Parameters
    ----------
    name : str
        Name of the campaign; with the folder of the file, or a number, if two are equal.
    recording : Recording
        Recording of the campaign.
    iterations : IterationTable
        Numbers of its playbacks.
    verdict : Verdict
        Verdict whether its target was reached.
    """

    name: str
    recording: Recording
    iterations: IterationTable
    verdict: Verdict


@dataclass(frozen=True)
class ChannelComparison:
    """Values of one response channel of one recording after its best playback; all are ratios, NaN if not reported.

    Parameters
    ----------
    recording, channel : str
        Names of the recording and of the channel.
    first_error, relative_rms_error : float
        rms(target - response) / rms(target) after the first and after the best playback; 0 is perfect.
    rms_response, peak_ratio : float
        RMS and peak of the response over those of the target; 1 is perfect.
    damage_ratio : tuple of float
        Pseudo-damage of the response over that of the target, for S-N lines of slope 3, 5 and 8.
    identification_damage, damage_spent : tuple of float
        Damage of the identification, and of the whole campaign, in passes of the target, for the same slopes. If the
        recording does not state the first, it is NaN and the second is that of the playbacks.
    watched : bool
        Whether the channel is only monitored: reported, but not judged.
    """

    recording: str
    channel: str
    first_error: float
    relative_rms_error: float
    rms_response: float
    peak_ratio: float
    damage_ratio: tuple[float, ...]
    identification_damage: tuple[float, ...]
    damage_spent: tuple[float, ...]
    watched: bool

    @property
    def damage_in_words(self) -> str:
        """Damage spent at slope 5 as text, with that of the identification in brackets."""
        column = DAMAGE_SLOPES.index(5)
        return f"{passes(self.damage_spent[column])} ({passes(self.identification_damage[column])})"


@dataclass(frozen=True, eq=False)
class Comparison:
    """Comparison of recorded campaigns; prints as tables.

    Parameters
    ----------
    recordings : tuple of ComparedRecording
        Two or more recordings, as given.
    channels : tuple of str
        Names of the responses common to all, in the first recording's order.
    rows : tuple of ChannelComparison
        Rows by channel, and within a channel in the order of the recordings.
    differences : tuple of SettingDifference
        Settings, rig and target that are not equal in all recordings.
    """

    recordings: tuple[ComparedRecording, ...]
    channels: tuple[str, ...]
    rows: tuple[ChannelComparison, ...]
    differences: tuple[SettingDifference, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Unique names of the recordings."""
        return tuple(entry.name for entry in self.recordings)

    @property
    def same_target(self) -> bool:
        """Whether all have the same target samples; otherwise a recording's numbers are relative to its own target."""
        return all(difference.setting != "target" for difference in self.differences)

    def of_channel(self, channel: str) -> tuple[ChannelComparison, ...]:
        """Return the rows of one channel, in the order of the recordings.

        Parameters
        ----------
        channel : str
            Name of a response.

        Returns
        -------
        tuple of ChannelComparison
            Rows; empty if no recording has the channel.
        """
        return tuple(row for row in self.rows if row.channel == channel)

    def to_document(self) -> dict[str, Any]:
        """Return the comparison as plain strings, numbers, lists and mappings, with None for unreported numbers."""
        return {
            "recordings": [
                {
                    "name": entry.name,
                    "path": str(entry.recording.path),
                    "judgement": entry.verdict.judgement.value,
                    "sentence": entry.verdict.sentence,
                    "accept": asdict(entry.verdict.limits),
                    "playbacks": len(entry.iterations),
                    "best_playback": entry.iterations.numbers[entry.iterations.best],
                    "overall_relative_rms_error": _plain(float(entry.iterations.overall[entry.iterations.best])),
                    "overall_per_playback": [_plain(float(value)) for value in entry.iterations.overall],
                }
                for entry in self.recordings
            ],
            "channels": [
                {
                    "recording": row.recording,
                    "channel": row.channel,
                    "first_error": _plain(row.first_error),
                    "relative_rms_error": _plain(row.relative_rms_error),
                    "rms_response": _plain(row.rms_response),
                    "peak_ratio": _plain(row.peak_ratio),
                    **{
                        name: {
                            str(slope): _plain(value)
                            for slope, value in zip(DAMAGE_SLOPES, getattr(row, name), strict=True)
                        }
                        for name in _BY_SLOPE
                    },
                    "watched": row.watched,
                }
                for row in self.rows
            ],
            "differences": [
                {"setting": difference.setting, "values": dict(zip(self.names, difference.values, strict=True))}
                for difference in self.differences
            ],
        }

    def to_xarray(self) -> xarray.Dataset:
        """Return the numbers of the best playbacks over `recording`, `channel` and `slope` (of the S-N line)."""
        import xarray

        def over_channels(name: str) -> list[list[Any]]:
            return [[getattr(row, name) for row in self.rows if row.recording == recording] for recording in self.names]

        plain = ("first_error", "relative_rms_error", "rms_response", "peak_ratio")
        return xarray.Dataset(
            {
                **{name: (("recording", "channel"), over_channels(name), {"units": "1"}) for name in plain},
                **{
                    name: (("recording", "channel", "slope"), over_channels(name), {"units": "1"}) for name in _BY_SLOPE
                },
            },
            coords={"recording": list(self.names), "channel": list(self.channels), "slope": list(DAMAGE_SLOPES)},
        )

    def __repr__(self) -> str:
        """Return a one-line description without numbers."""
        return f"Comparison({', '.join(self.names)}: {len(self.channels)} channels)"

    def __str__(self) -> str:
        """Return the verdicts, the errors by channel, and the differing settings as text."""
        from duralab.display import text_table

        verdicts = "\n".join(f"{entry.name}: {entry.verdict.sentence}" for entry in self.recordings)
        errors = text_table(("", *self.names), self._error_rows(), left=1)
        spent = text_table(("", *self.names), self._damage_rows(), left=1)
        text = "\n\n".join((verdicts, f"{_ERRORS}\n{errors}", f"{_SPENT}\n{spent}"))
        if self.differences:
            lines = "\n".join(f"{row.setting}: {'; '.join(row.values)}" for row in self.differences)
            text += f"\n\nsettings that differ\n{lines}"
        return text

    def _repr_html_(self) -> str:
        from duralab.display import html_table

        verdicts = [(entry.name, entry.verdict.judgement.value, entry.verdict.sentence) for entry in self.recordings]
        differences = [(row.setting, *row.values) for row in self.differences]
        return "".join(
            (
                html_table(("recording", "verdict", "in words"), verdicts, left=3),
                html_table(("", *self.names), self._error_rows(), left=1, caption=_ERRORS),
                html_table(("", *self.names), self._damage_rows(), left=1, caption=_SPENT),
                html_table(("setting", *self.names), differences, left=1 + len(self.names)) if differences else "",
            )
        )

    def _error_rows(self) -> list[tuple[str, ...]]:
        return [
            (channel.replace("_", " "), *(_figure(row.relative_rms_error) for row in self.of_channel(channel)))
            for channel in self.channels
        ]

    def _damage_rows(self) -> list[tuple[str, ...]]:
        return [
            (channel.replace("_", " "), *(row.damage_in_words for row in self.of_channel(channel)))
            for channel in self.channels
        ]


def compare(*recordings: str | Path | Recording | Recorded) -> Comparison:
    """Compare recorded campaigns.

    Parameters
    ----------
    *recordings : str, Path, Recording or Recorded
        Two or more recordings, each with at least one playback, and with at least one response name in common.

    Returns
    -------
    Comparison
        Comparison in the given order.

    Raises
    ------
    InputError
        There are fewer than two recordings, one cannot be read or has no playback, or they have no common channel.
    """
    if len(recordings) < 2:
        raise InputError(f"{len(recordings)} recording is given to compare; give two or more.")
    opened = [_opened(recording) for recording in recordings]
    for recording in opened:
        if not len(recording.iterations):
            raise InputError(
                f"The recording {recording.path} holds no playback of the target, so there is nothing to compare; "
                "leave it out."
            )
    first = opened[0].iterations.channels
    channels = tuple(name for name in first if all(name in recording.iterations.channels for recording in opened))
    if not channels:
        named = "; ".join(f"{recording.path} has {', '.join(recording.iterations.channels)}" for recording in opened)
        raise InputError(f"The recordings have no response channel in common ({named}); compare those of one rig.")
    entries = tuple(_entry(name, recording) for name, recording in zip(_names(opened), opened, strict=True))
    return Comparison(
        recordings=entries,
        channels=channels,
        rows=tuple(_row(entry, channel) for channel in channels for entry in entries),
        differences=differing_settings(opened),
    )


def _opened(recording: str | Path | Recording | Recorded) -> Recording:
    if isinstance(recording, Recording):
        return recording
    return recording.recording if isinstance(recording, Recorded) else open_recording(recording)


def _names(recordings: Sequence[Recording]) -> list[str]:
    """Return unique names: those of the campaigns; of equal ones with the folder, and if still equal with a number."""
    names = [recording.specification.id for recording in recordings]
    if len(set(names)) < len(names):
        names = [
            f"{recording.path.resolve().parent.name}/{name}" for recording, name in zip(recordings, names, strict=True)
        ]
    twice = {name for name, count in Counter(names).items() if count > 1}
    return [f"{name} ({number})" if name in twice else name for number, name in enumerate(names, start=1)]


def _entry(name: str, recording: Recording) -> ComparedRecording:
    table = recording.iterations
    return ComparedRecording(name=name, recording=recording, iterations=table, verdict=recording.verdict)


def _row(entry: ComparedRecording, channel: str) -> ChannelComparison:
    table = entry.iterations
    column = table.channels.index(channel)
    return ChannelComparison(
        recording=entry.name,
        channel=channel,
        first_error=float(table.relative_rms_error[0, column]),
        relative_rms_error=float(table.relative_rms_error[table.best, column]),
        rms_response=float(table.rms_response[table.best, column]),
        peak_ratio=float(table.peak_ratio[table.best, column]),
        damage_ratio=tuple(float(ratio) for ratio in table.damage_ratio[table.best, column]),
        identification_damage=tuple(float(damage) for damage in table.identification_damage[column]),
        damage_spent=tuple(float(table.damage_spent(slope)[-1, column]) for slope in DAMAGE_SLOPES),
        watched=bool(table.watched[column]),
    )


def _plain(value: float) -> float | None:
    """Return a number, or None for NaN, which JSON does not have."""
    return None if isnan(value) else value


def _figure(value: float) -> str:
    return "–" if isnan(value) else f"{value:.3f}"
