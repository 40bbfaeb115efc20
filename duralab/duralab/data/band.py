"""Description of recorded signals, including whether they are filtered to the control band."""

from __future__ import annotations

from dataclasses import dataclass

from duralab_proto.v1 import iterator_pb2


@dataclass(frozen=True)
class BandNote:
    """Description of recorded signals, with whether they are in the control band.

    `quantity`: "target", "response" or "error". `in_band`: Whether the signals are in the form used for judging: in the
    control band, without their static part, or, if the band begins at 0 Hz, without the rig's static response.
    `lowest_frequency`, `highest_frequency`: Edges of the control band, in hertz. `level`: Scaling of a playback at
    partial level; empty for a target.
    """

    quantity: str
    in_band: bool
    lowest_frequency: float
    highest_frequency: float
    level: str = ""

    @property
    def band(self) -> str:
        """Value of the coordinate `band`."""
        return "in band" if self.in_band else "as measured"

    @property
    def static_part(self) -> str:
        """Treatment of the static part: for a control band from 0 Hz, relative to the rig's static response."""
        if not self.in_band:
            return "kept"
        return "removed" if self.lowest_frequency > 0.0 else "relative to the rig's static response"

    @property
    def attributes(self) -> dict[str, str | float]:
        """Attributes of labelled arrays; only in-band signals have the edges of the band."""
        edges = {"lowest_frequency": self.lowest_frequency, "highest_frequency": self.highest_frequency}
        return {
            "quantity": self.quantity,
            "band": self.band,
            **(edges if self.in_band else {}),
            "static_part": self.static_part,
            **({"level": self.level} if self.level else {}),
        }


def response_note(specification: iterator_pb2.CampaignSpec, *, in_band: bool, quantity: str = "response") -> BandNote:
    """Return the note of the responses of a campaign.

    `specification`: Specification of the campaign. `in_band`: Whether the signals are in the control band. `quantity`:
    "response", or "error".
    Returns: The note.
    """
    return BandNote(
        quantity,
        in_band,
        specification.lowest_frequency,
        specification.highest_frequency,
        level="divided by the level of the playback" if in_band else "as played",
    )


def target_note(specification: iterator_pb2.CampaignSpec, *, in_band: bool) -> BandNote:
    """Return the note of the target of a campaign.

    `specification`: Specification of the campaign. `in_band`: Whether the signals are in the control band.
    Returns: The note.
    """
    return BandNote("target", in_band, specification.lowest_frequency, specification.highest_frequency)
