"""Drives like those of a campaign: coloured noise on every channel, at a share of the channel's limits."""

import numpy as np

from rig_sim import PlayableRig, RigFaultError

LOWEST, HIGHEST = 0.7, 40.0
FADE_SECONDS = 0.5
SPEED = 15.0
SHARES = (0.04, 0.02, 0.01, 0.005)
TRIAL_SECONDS = 5.0


def noise_drive(rig: PlayableRig, *, seconds: float, share: float, seed: int = 0) -> np.ndarray:
    """Return a drive that begins and ends at zero; speeds are constant.

    Parameters
    ----------
    rig : PlayableRig
    seconds : float
    share : float
        RMS over the smaller limit of each channel.
    seed : int

    Returns
    -------
    ndarray, (drives, samples)
        Noise between 0.7 and 40 Hz whose amplitude falls with frequency, each channel in its unit.
    """
    rate = rig.specimen.sample_rate
    samples = round(seconds * rate)
    rng = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(samples, 1.0 / rate)
    shape = np.where((frequency >= LOWEST) & (frequency <= HIGHEST), 1.0 / np.maximum(frequency, LOWEST), 0.0)
    time = np.arange(samples) / rate
    fade = np.clip(np.minimum(time, time[-1] - time) / FADE_SECONDS, 0.0, 1.0)
    drive = np.empty((len(rig.specimen.drives), samples))
    for row, channel in enumerate(rig.specimen.drives):
        if channel.unit == "m/s":
            drive[row] = SPEED
            continue
        phases = np.exp(2j * np.pi * rng.random(len(frequency)))
        noise = np.fft.irfft(shape * phases, n=samples)
        limit = min(channel.maximum, -channel.minimum) if channel.minimum < 0.0 else channel.maximum
        drive[row] = fade * noise * share * limit / np.sqrt(np.mean(noise**2))
    return drive


def playable_share(rig: PlayableRig) -> float:
    """Return the largest share that the rig plays to the end without a fault.

    Raises
    ------
    ValueError
        When even the smallest one is a fault.
    """
    for share in SHARES:
        try:
            for _ in rig.playback(noise_drive(rig, seconds=TRIAL_SECONDS, share=share), seed=1).blocks():
                pass
        except RigFaultError:
            continue
        return share
    raise ValueError(f"{rig.specimen.name} plays no noise of {SHARES[-1]:g} of its limits; lower the shares.")
