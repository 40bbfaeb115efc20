"""Road as a rolling tyre follows it: effective height, slope and camber of the road under each wheel.

The tyre bridges features shorter than itself. First, each of five parallel disks rolls over its line of the road
(Zegelaar's basic curve: the upper envelope of a circle, which enters a hole gently and rounds a step). Then the mean
over the contact length is computed. Its derivative is the difference between the envelope at the patch's front and rear
edge over its length: Schmeitz' tandem slope, with the mean over the patch instead of over two cams. Height and slope
are therefore exactly consistent (slope = d height/dx), and a wave much longer than the patch passes with gain 1.
Schmeitz' ellipses would need shape parameters that are measured per tyre; the circle needs only the radius.

Sources: P.W.A. Zegelaar, The dynamic response of tyres to brake torque variations and road unevennesses, PhD thesis,
TU Delft 1998; A.J.C. Schmeitz, A semi-empirical three-dimensional model of the pneumatic tyre rolling over
arbitrarily uneven road surfaces, PhD thesis, TU Delft 2004 (two-point follower and parallel tandem cams).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from duralab_roads.road import Road

EFFECTIVE_INPUTS = ("left_height", "left_slope", "left_camber", "right_height", "right_slope", "right_camber")
"""Order of the channels of `effective_inputs`."""

FINEST_STEP = 0.005
"""Largest step of the rolling disk [m]; a circle of 0.3 m at this step is at most 1e-5 m too low."""

DISKS = 5
"""Number of parallel disks over the contact width."""

STOPBAND_DECIBEL = 80.0
PASSBAND_EDGE, STOPBAND_EDGE = 0.8, 1.0
"""Edges of the anti-aliasing filter over the Nyquist frequency of the output."""


def effective_inputs(
    road: Road,
    *,
    speed: float,
    sample_rate: float,
    samples: int,
    track_width: float,
    tyre_radius: float,
    contact_length: float,
    contact_width: float,
    lead_in_seconds: float,
    axle_distances: Sequence[float] = (0.0,),
) -> NDArray[np.float64]:
    """Return the road inputs of each axle's tyres to their wheels at constant speed.

    The common mean height of all tracks is subtracted, and all inputs fade in from and out to flat ground, so that a
    rig at rest has no jump. The slope stays the derivative of the faded height. `level` a measured road before.
    An axle meets the same road later, by its distance over the speed, also if that is not a whole number of samples.
    All axles fade at the same time: outside of the fades a following axle gets the inputs of the first one.

    Parameters
    ----------
    road
        Road that is long enough for the drive; its ends are continued flat for the reach of tyre and filter.
    speed
        Forward speed [m/s], above 0.
    sample_rate
        Samples per second [Hz], above 0. Waves above 0.4 times this rate are filtered out (80 dB from 0.5 times on).
    samples
        Length of the result, at least 2.
    track_width
        Distance of the wheels [m]; they roll at v = ± half of it.
    tyre_radius
        Free radius of the tyre [m], above half the contact length.
    contact_length, contact_width
        Size of the contact patch [m], above 0.
    lead_in_seconds
        Duration of the fade at either end [s], above 0, at most half of the drive.
    axle_distances
        Distance of each axle behind the first one [m], 0 or more; before its start the road continues flat.

    Returns
    -------
    ndarray
        Shape (6 axles, samples), for each axle in the order of `EFFECTIVE_INPUTS`: height [m]; slope dz/dx [1],
        positive uphill; camber dz/dv [1], positive when higher on the left. First and last sample are 0.

    Raises
    ------
    ValueError
        If a parameter is out of range, the road is too short or too narrow, or a NaN is in a wheel's track.

    Source: see the module.
    """
    _check_drive(
        road,
        positive={
            "speed": speed,
            "sample_rate": sample_rate,
            "track_width": track_width,
            "tyre_radius": tyre_radius,
            "contact_length": contact_length,
            "contact_width": contact_width,
            "lead_in_seconds": lead_in_seconds,
        },
        samples=samples,
        axle_distances=axle_distances,
    )
    advance = speed / sample_rate
    oversampling = max(2, math.ceil(advance / FINEST_STEP - 1e-9))
    step = advance / oversampling
    filters = _patch_filters(contact_length, step=step, oversampling=oversampling)
    wheels = [
        _wheel(
            road,
            centre=side * track_width / 2,
            behind=behind,
            width=contact_width,
            radius=tyre_radius,
            step=step,
            oversampling=oversampling,
            samples=samples,
            filters=filters,
        )
        for behind in axle_distances
        for side in (1, -1)
    ]
    inputs = np.concatenate(wheels)
    inputs[0::3] -= inputs[0::3].mean()
    return _faded(inputs, speed=speed, sample_rate=sample_rate, lead_in_seconds=lead_in_seconds)


def _check_drive(road: Road, *, positive: Mapping[str, float], samples: int, axle_distances: Sequence[float]) -> None:
    """Refuse impossible parameters; `positive` are the numbers of `effective_inputs` above 0, by their names."""
    for name, value in positive.items():
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value}; it must be finite and above 0.")
    if not axle_distances or not all(math.isfinite(distance) and distance >= 0 for distance in axle_distances):
        raise ValueError(
            f"axle_distances is {tuple(axle_distances)}; give at least one distance, each finite and 0 or more."
        )
    contact_length, tyre_radius = positive["contact_length"], positive["tyre_radius"]
    if contact_length >= 2 * tyre_radius:
        raise ValueError(
            f"contact_length is {contact_length} m; a tyre of radius {tyre_radius} m is shorter than that."
        )
    lead_in_seconds, sample_rate = positive["lead_in_seconds"], positive["sample_rate"]
    if samples < 2 or 2 * lead_in_seconds * sample_rate > samples - 1:
        raise ValueError(
            f"{samples} samples at {sample_rate} Hz are shorter than two lead-ins of {lead_in_seconds} s; "
            "ask for more samples or a shorter lead-in."
        )
    distance = (samples - 1) * (positive["speed"] / sample_rate)
    if distance > road.length * (1 + 1e-9):
        raise ValueError(
            f"The drive covers {distance:.2f} m, the road has {road.length:.2f} m; lengthen it with repeat_mirrored "
            "or ask for fewer samples."
        )


def _wheel(
    road: Road,
    *,
    centre: float,
    behind: float,
    width: float,
    radius: float,
    step: float,
    oversampling: int,
    samples: int,
    filters: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return height, slope and camber (3, samples) of one wheel, before mean and fading."""
    margin = filters[0].size // 2
    reach = math.ceil(radius / step)
    rows = (samples - 1) * oversampling + 1
    along = step * np.arange(-margin - reach, rows + margin + reach, dtype=np.float64) - behind
    offsets = np.linspace(-width / 2, width / 2, DISKS)
    height = np.zeros(rows + 2 * margin)
    camber = np.zeros_like(height)
    for offset in offsets:
        disk = _rolled_over(_line(road, centre + offset, along), radius=radius, step=step, reach=reach)
        height += disk / DISKS
        camber += disk * offset / np.sum(offsets**2)
    mean_filter, slope_filter = filters
    return np.stack(
        [
            np.convolve(height, mean_filter, mode="valid")[::oversampling],
            np.convolve(height, slope_filter, mode="valid")[::oversampling],
            np.convolve(camber, mean_filter, mode="valid")[::oversampling],
        ]
    )


def _line(road: Road, position: float, along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate the road at one lateral position [m]; beyond its ends the last height continues."""
    positions = road.lateral_positions
    slack = 1e-9
    if not positions[0] - slack <= position <= positions[-1] + slack:
        raise ValueError(
            f"A tyre reaches v = {position:.3f} m, the road from {positions[0]:.3f} to {positions[-1]:.3f} m; "
            "take a narrower track or contact width, or a wider road."
        )
    rows = min(road.elevation.shape[0], max(math.ceil(along[-1] / road.spacing), 0) + 1)
    nearest = int(np.argmin(np.abs(positions - position)))
    if abs(positions[nearest] - position) <= slack:
        # On a column only that column counts: a NaN beside it is not in the wheel's track.
        line = road.elevation[:rows, nearest]
    else:
        left = int(np.searchsorted(positions, position))
        part = (position - positions[left - 1]) / (positions[left] - positions[left - 1])
        line = (1 - part) * road.elevation[:rows, left - 1] + part * road.elevation[:rows, left]
    if np.any(np.isnan(line)):
        raise ValueError(
            f"The road has no elevation (NaN) at u = {np.flatnonzero(np.isnan(line))[0] * road.spacing:.3f} m, "
            f"v = {position:.3f} m, below a tyre; move the track or fill the grid."
        )
    return np.interp(along, road.spacing * np.arange(rows), line)


def _rolled_over(line: NDArray[np.float64], *, radius: float, step: float, reach: int) -> NDArray[np.float64]:
    """Return the lowest height of a rolling disk that nowhere penetrates the line, `reach` points shorter per end."""
    offsets = np.arange(-reach, reach + 1)
    inside = np.abs(offsets * step) < radius
    rise = np.full(offsets.size, np.inf)
    rise[inside] = radius - np.sqrt(radius**2 - (offsets[inside] * step) ** 2)
    count = line.size - 2 * reach
    envelope = line[reach : reach + count].copy()
    # A point of the rim that is higher above the patch than the range of the whole line cannot touch it.
    for index in np.flatnonzero(rise <= np.ptp(line)):
        np.maximum(envelope, line[index : index + count] - rise[index], out=envelope)
    return envelope


def _patch_filters(
    contact_length: float, *, step: float, oversampling: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the filters for the mean over the patch and its derivative, each times the anti-aliasing low-pass.

    Both treat the envelope as piecewise linear and are exact for it, for patches of any length over the step.
    """
    # Kaiser's formulas for stop-band attenuations above 50 dB: scipy.signal has them too, and takes a second to import.
    width = math.pi * (STOPBAND_EDGE - PASSBAND_EDGE) / oversampling
    taps = (STOPBAND_DECIBEL - 7.95) / (2.285 * width) + 1.0
    beta = 0.1102 * (STOPBAND_DECIBEL - 8.7)
    cutoff = (STOPBAND_EDGE + PASSBAND_EDGE) / 2 / oversampling
    delay = math.ceil(math.ceil(taps) / 2)
    low_pass = np.sinc(cutoff * np.arange(-delay, delay + 1)) * np.kaiser(2 * delay + 1, beta)
    low_pass /= low_pass.sum()
    half = contact_length / 2 / step
    node = np.arange(-math.ceil(half) - 1, math.ceil(half) + 2, dtype=np.float64)
    mean = (_hat_integral(half - node) - _hat_integral(-half - node)) / (2 * half)
    front = np.maximum(1 - np.abs(half - node), 0)
    # A convolution mirrors its kernel: the mean is even, the slope must be reversed.
    slope = (front - front[::-1])[::-1] / contact_length
    mean_filter, slope_filter = (np.asarray(np.convolve(one, low_pass), dtype=np.float64) for one in (mean, slope))
    return mean_filter, slope_filter


def _hat_integral(upper: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integrate the hat function max(1 - |t|, 0) from minus infinity to `upper`."""
    bounded = np.clip(upper, -1, 1)
    return 0.5 + bounded - np.sign(bounded) * bounded**2 / 2


def _faded(
    inputs: NDArray[np.float64], *, speed: float, sample_rate: float, lead_in_seconds: float
) -> NDArray[np.float64]:
    """Fade (6 axles, samples) at both ends; velocity and acceleration of the fade are 0 at its start and end."""
    samples = inputs.shape[1]
    time = np.arange(samples) / sample_rate
    phase = np.minimum(time, time[::-1]) / lead_in_seconds
    part = np.minimum(phase, 1)
    fade = part**3 * (10 - 15 * part + 6 * part**2)
    direction = np.where(time <= time[-1] / 2, 1, -1)
    fade_slope = direction * 30 * part**2 * (1 - part) ** 2 / (lead_in_seconds * speed)
    faded = inputs * fade
    faded[1::3] += inputs[0::3] * fade_slope
    return np.ascontiguousarray(faded)
