"""Drive map of an identification: learned from its record, with the FRF estimated again on mapped drives."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from duralab_drive_map import DriveMap, LearnedDriveMap, learn_drive_map
from duralab_proto.v1 import array_pb2
from identifier.estimators import FrfEstimate
from identifier.experiment import RigUnderTest
from identifier.modelling.line_filling import fill_lines


@dataclass(frozen=True)
class EstimatedFrf:
    """An estimate, with its FRF at every line of its band; a `duralab_drive_map.FrfModel`."""

    estimate: FrfEstimate
    frf: NDArray[np.complex128]
    identified: slice

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Frequency of each line, Hz."""
        return self.estimate.frequency

    @classmethod
    def of(cls, estimate: FrfEstimate) -> "EstimatedFrf":
        """Interpolate the lines that the excitation leaves out."""
        known = np.flatnonzero(estimate.valid)
        return cls(estimate, fill_lines(estimate).frf, slice(int(known[0]), int(known[-1]) + 1))


def learn_map(
    drive: NDArray[np.float64],
    response: NDArray[np.float64],
    *,
    estimate: FrfEstimate,
    estimate_again: Callable[[NDArray[np.float64]], FrfEstimate],
    rig: RigUnderTest,
    response_weight: NDArray[np.float64] | None,
    start: DriveMap | None = None,
) -> LearnedDriveMap[EstimatedFrf]:
    """Learn the drive map of a rig from the record of its identification.

    `drive`, `response`: Shapes (drives, samples) and (responses, samples), as played and measured. `estimate`: Estimate
    on the played drives, or on those that `start` maps. `estimate_again`: Function for an estimate on mapped drives and
    the same response; may raise ValueError. `response_weight`: Shape (responses), 0 or more. `start`: Map that is
    learned again; it is not the identity.
    Returns: The identity with the given estimate, and a remark, if the chosen map cannot be used; `start` without
    chosen terms if it is kept.
    """
    learned = learn_drive_map(
        drive,
        response,
        model=EstimatedFrf.of(estimate),
        names=tuple(channel.name for channel in rig.drives),
        units=tuple(channel.unit for channel in rig.drives),
        response_weight=response_weight,
        estimate=None if start is not None else lambda mapped: EstimatedFrf.of(estimate_again(mapped)),
        start=start,
        # A force-controlled drive moves along an arc without a map.
        may_follow=[channel.kind == array_pb2.CHANNEL_KIND_DISPLACEMENT for channel in rig.drives],
    )
    if start is not None:
        if not learned.chosen:
            return learned
        return replace(learned, model=EstimatedFrf.of(estimate_again(learned.drive_map.to_mapped(drive))))
    beyond = [
        channel.name
        for i, channel in enumerate(rig.drives)
        if any(i in (term.follower, *term.product) for term in learned.drive_map.terms)
        and not channel.minimum <= 0.0 <= channel.maximum
    ]
    if not beyond:
        return learned
    return LearnedDriveMap(
        drive_map=replace(learned.drive_map, terms=()),
        model=EstimatedFrf.of(estimate),
        chosen=(),
        remarks=(
            *learned.remarks,
            f"No drive map is used: the limits of {', '.join(beyond)} do not hold 0, where mapped drives rest; shift "
            "the drive.",
        ),
    )
