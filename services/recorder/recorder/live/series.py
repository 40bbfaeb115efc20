"""Curves of the live view: their paths in the viewer's tree, and their style.

Data of a viewer's time series cannot be removed, so each playback has separate entities:
`<group>/<channel>/<playback>` on the timeline `run_time`. A new playback changes only the style of the earlier ones:
they are hidden, and a click in the legend shows them again.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, TypeAlias

import rerun as rr

from duralab_proto.v1 import array_pb2
from recorder.live.playbacks import Playback

RUN_TIME: Final = "run_time"
"""Timeline of all signals: time since the start of the playback."""

ITERATION: Final = "iteration"
"""Timeline of the figures, which are also shown as bar charts."""

TARGET: Final = Playback("0 target")
"""Playback of the target's curve, which every response is compared with. Curves are drawn in the order of their paths:
the digit puts the target below the responses, where its broad line stays visible on both sides of them."""

Colour: TypeAlias = tuple[int, int, int]

TARGET_COLOUR: Final[Colour] = (126, 132, 142)
LATEST_COLOUR: Final[Colour] = (232, 119, 34)
LIMIT_COLOUR: Final[Colour] = (214, 69, 65)
FIRST_COLOUR: Final[Colour] = (86, 156, 214)
CHANNEL_COLOURS: Final[tuple[Colour, ...]] = (
    (78, 121, 167),
    (242, 142, 43),
    (89, 161, 79),
    (225, 87, 89),
    (118, 183, 178),
    (176, 122, 161),
    (237, 201, 72),
    (156, 117, 95),
)


class Group(Enum):
    """Kind of a curve's signal; the first part of its path."""

    RESPONSE = "response"
    """Response in the control band, compared with the target."""
    MEASURED = "measured"
    """Response as measured, drawn during the playback."""
    DRIVE = "drive"


class Look(Enum):
    """Emphasis of a curve."""

    TARGET = "target"
    LATEST = "latest"
    FIRST = "first"
    EARLIER = "earlier"
    REPEATED = "repeated"
    """An attempt that was followed by another attempt."""


@dataclass(frozen=True)
class Curve:
    """One curve of one playback.

    `group`: Kind of its signal. `channel`: Name of the channel in the rig's description. `playback`: `TARGET`, or a
    playback of the campaign.
    """

    group: Group
    channel: str
    playback: Playback

    @property
    def path(self) -> str:
        """Entity path; names are escaped, so that none of them can add levels to the tree."""
        return f"{self.group.value}/{rr.escape_entity_path_part(self.channel)}/" + rr.escape_entity_path_part(
            self.playback.entity
        )

    def style(self, look: Look) -> rr.SeriesLines:
        """Return the style of the curve: name, colour, width, and whether it is visible without a click."""
        name = self.playback.name
        match look:
            case Look.TARGET:
                return _line(names="target", colors=TARGET_COLOUR, widths=4.0)
            case Look.LATEST:
                return _line(names=f"{name} (latest)", colors=LATEST_COLOUR, widths=1.2)
            case Look.FIRST:
                return _line(names=f"{name} (first)", colors=FIRST_COLOUR, widths=0.8)
            case Look.EARLIER:
                return _line(names=name, colors=FIRST_COLOUR, widths=0.8, visible_series=[False])
            case Look.REPEATED:
                names = f"{name} (attempt {self.playback.attempt})"
                return _line(names=names, colors=FIRST_COLOUR, widths=0.8, visible_series=[False])


def _line(**look: Any) -> rr.SeriesLines:
    # By default the viewer averages the samples of a pixel, which lowers the peaks.
    return rr.SeriesLines(aggregation_policy=rr.components.AggregationPolicy.MinMax, **look)


def channel_path(group: Group, channel: str) -> str:
    """Return the path above all curves of a channel."""
    return f"{group.value}/{rr.escape_entity_path_part(channel)}"


def with_unit(channel: array_pb2.Channel) -> str:
    """Return the title of a channel's plot, e.g. "left_vertical [N]"."""
    return f"{channel.name} [{channel.unit}]"


def colour_of(index: int) -> Colour:
    """Return the colour of the channel with an index in its rig's order."""
    return CHANNEL_COLOURS[index % len(CHANNEL_COLOURS)]
