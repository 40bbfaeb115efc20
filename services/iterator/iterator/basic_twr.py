"""Basic Time Waveform Replication: the update with a fixed inverse model."""

from __future__ import annotations

from iterator.drive_update import NextDrive, UpdateSettings
from iterator.iteration_history import IterationHistory
from iterator.rig_model import RigModel, apply_inverse


def next_drive(history: IterationHistory, model: RigModel, settings: UpdateSettings) -> NextDrive:
    """Return `U_{k+1} = U_k + Ĥ† Q E_k` (Eq. 2), or `U_1 = Ĥ† Q Y_d` before the first playback.

    Parameters
    ----------
    history : IterationHistory
        The last playback is the one corrected.
    model : RigModel
        Stays as it is.
    settings : UpdateSettings
        Its control band and iteration gain are used.

    Returns
    -------
    NextDrive
        The drive, and `model`.

    Raises
    ------
    ValueError
        Gain, target and model differ in their number of responses.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eqs. 2 and 3.
    """
    responses = model.frf.shape[1]
    if history.target.shape[0] != responses or settings.iteration_gain.size != responses:
        raise ValueError(
            f"The model has {responses} responses, the target {history.target.shape[0]} and the iteration gain "
            f"{settings.iteration_gain.size}; all must be equal."
        )
    gain = settings.iteration_gain[:, None]
    if not history.playbacks:
        return NextDrive(drive=apply_inverse(model, gain * history.target, band=settings.band), model=model)
    last = history.playbacks[-1]
    step = apply_inverse(model, gain * (history.target - last.response), band=settings.band)
    return NextDrive(drive=last.drive + step, model=model)
