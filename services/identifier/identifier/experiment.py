"""From the record of a playback to the estimate."""

import numpy as np
from numpy.typing import ArrayLike

from identifier.h1 import FrfEstimate, estimate_h1
from identifier.settings import ExperimentSettings
from spectra import as_record


def estimate_experiment(
    settings: ExperimentSettings, *, drive: ArrayLike, response: ArrayLike, sample_rate: float
) -> FrfEstimate:
    """Estimate the FRF matrix from what was played and measured.

    The fades are dropped. Of what is left each channel's own mean is taken off, not the description's static response:
    under excitation the mean moves away from the value at rest (friction, asymmetric dampers, bump stops), and a real
    transducer's zero drifts; the FRF describes the motion about that working point.

    Parameters
    ----------
    settings
        Of the experiment.
    drive
        Shape (drives, samples), as played, fades included.
    response
        Shape (responses, samples), as measured.
    sample_rate
        In hertz.

    Returns
    -------
    FrfEstimate
        In the band of the excitation.

    Raises
    ------
    ValueError
        Where the records do not agree or do not identify the rig; see `estimate_h1`.
    """
    fade = settings.fade_samples(sample_rate)
    played, measured = as_record(drive, name="drive"), as_record(response, name="response")
    if played.shape[1] != measured.shape[1]:
        raise ValueError(
            f"{played.shape[1]} samples were played and {measured.shape[1]} measured; a playback gives as many back."
        )
    used = slice(fade, played.shape[1] - fade)
    played, measured = played[:, used], measured[:, used]
    return estimate_h1(
        played - np.mean(played, axis=1, keepdims=True),
        measured - np.mean(measured, axis=1, keepdims=True),
        block_samples=settings.block_samples,
        overlap=settings.overlap,
        sample_rate=sample_rate,
        lowest=settings.spectrum.lowest_frequency,
        highest=settings.spectrum.highest_frequency,
    )
