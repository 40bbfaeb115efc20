"""Estimate from the record of a playback."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_settings import EstimatorSettings
from duralab_spectra import as_record
from identifier.estimators import EstimatorOptions, FrfEstimate, estimate
from identifier.layout import Layout


def estimate_experiment(
    settings: EstimatorSettings, layout: Layout, *, drive: ArrayLike, response: ArrayLike
) -> FrfEstimate:
    """Estimate the FRF matrix from the played drive and the measured response.

    Each channel's own mean over the used samples is subtracted, not the description's static response: under excitation
    the mean moves away from the value at rest (friction, asymmetric dampers, bump stops), and a real transducer's zero
    drifts; the FRF describes the motion about that working point.

    Parameters
    ----------
    settings
        Settings of the estimator.
    layout
        Layout of the drive.
    drive
        Shape (drives, samples), as played, fades and delays included.
    response
        Shape (responses, samples), as measured.

    Returns
    -------
    FrfEstimate
        Estimate at the excited lines.

    Raises
    ------
    ValueError
        The records do not agree or do not identify the rig; see `estimate`.
    """
    played, measured = as_record(drive, name="drive"), as_record(response, name="response")
    of_drives, of_responses = _means(played, layout), _means(measured, layout)
    return estimate(
        settings.kind,
        played - of_drives[:, None],
        measured - of_responses[:, None],
        layout,
        EstimatorOptions(order=settings.local_order, half_width=settings.local_half_width),
        taken_off=(of_drives, of_responses),
    )


def _means(record: NDArray[np.float64], layout: Layout) -> NDArray[np.float64]:
    stretches = [slice(each.start, each.start + layout.samples_of(each)) for each in layout.captures]
    total = sum(np.sum(record[:, stretch], axis=1) for stretch in stretches)
    used = sum(stretch.stop - stretch.start for stretch in stretches)
    return np.asarray(total) / used
