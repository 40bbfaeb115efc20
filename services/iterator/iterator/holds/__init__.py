"""Hold points: playbacks that a campaign waits before, its proposals, and the changes of a decision."""

from iterator.holds.basis import Basis
from iterator.holds.bounds import hold_reason
from iterator.holds.lineage import Lineage, Revision
from iterator.holds.proposed import Decide, DriveUse, ProposedPlayback, drive_use

__all__ = [
    "Basis",
    "Decide",
    "DriveUse",
    "Lineage",
    "ProposedPlayback",
    "Revision",
    "drive_use",
    "hold_reason",
]
