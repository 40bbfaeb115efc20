"""Several recorded campaigns beside each other: what each reached, channel by channel, and which settings differ."""

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
    """Anything with a recording, such as a `CampaignResult`."""

    @property
    def recording(self) -> Recording:
        """The recording."""
        ...


@dataclass(frozen=True, eq=False)
class ComparedRecording:
    """One of the recordings of a comparison.

    Parameters
    ----------
    name : str
        The campaign's name; with the folder of the file, or a number, where two have the same.
    recording : Recording
        What was recorded.
    iterations : IterationTable
        The figures of its playbacks.
    verdict : Verdict
        Whether its target was reached.
    """

    name: str
    recording: Recording
    iterations: IterationTable
    verdict: Verdict


@dataclass(frozen=True)
class ChannelComparison:
    """One response channel of one recording after its best playback; ratios all, nan where one is not told.

    Parameters
    ----------
    recording, channel : str
        Their names.
    first_error, relative_rms_error : float
        rms(target - response) / rms(target) after the first and after the best playback; 0 is perfect.
    rms_response, peak_ratio : float
        Of the response over that of the target; 1 is perfect.
    damage_ratio : tuple of float
        Pseudo-damage of the response over that of the target, for S-N lines of slope 3, 5 and 8.
    identification_damage, damage_spent : tuple of float
        Damage that the identification, and the whole campaign, put into the specimen, in passes of the target, for the
        same slopes. Where the recording does not state the first, it is nan and the second is that of the playbacks.
    watched : bool
        Told, but not judged.
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
        """Damage spent at slope 5 as text, in brackets that of the identification."""
        column = DAMAGE_SLOPES.index(5)
        return f"{passes(self.damage_spent[column])} ({passes(self.identification_damage[column])})"


@dataclass(frozen=True, eq=False)
class Comparison:
    """Recorded campaigns beside each other; `print` shows it as tables.

    Parameters
    ----------
    recordings : tuple of ComparedRecording
        Two or more, as given.
    channels : tuple of str
        The responses that all have in common, in the first one's order.
    rows : tuple of ChannelComparison
        Channel by channel, and within each in the order of the recordings.
    differences : tuple of SettingDifference
        Settings, rig and target that are not the same in all.
    """

    recordings: tuple[ComparedRecording, ...]
    channels: tuple[str, ...]
    rows: tuple[ChannelComparison, ...]
    differences: tuple[SettingDifference, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings, each different."""
        return tuple(entry.name for entry in self.recordings)

    @property
    def same_target(self) -> bool:
        """Whether all were to reproduce the same samples; where not, each one's figures are relative to its own."""
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
            Empty where no recording has the channel.
        """
        return tuple(row for row in self.rows if row.channel == channel)

    def to_document(self) -> dict[str, Any]:
        """Return the comparison as plain texts, numbers, lists and mappings; unreported figures have the value None."""
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
        """Return the figures of the best playbacks over `recording`, `channel` and `slope` (of the S-N line)."""
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
        """Return it on one line, without figures."""
        return f"Comparison({', '.join(self.names)}: {len(self.channels)} channels)"

    def __str__(self) -> str:
        """Return the tables as text: what each reached, the errors channel by channel, the settings that differ."""
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
        Two or more, each with a playback at least and with responses of the same names, some of them at least.

    Returns
    -------
    Comparison
        In the order given.

    Raises
    ------
    InputError
        Fewer than two, one that cannot be read or holds no playback, or no channel that all have in common.
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
    """Return a different name for each: the campaign's, with the folder where that says more, else with a number."""
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
    """Return a figure, or None for one that is not told: JSON knows no nan."""
    return None if isnan(value) else value


def _figure(value: float) -> str:
    return "–" if isnan(value) else f"{value:.3f}"
