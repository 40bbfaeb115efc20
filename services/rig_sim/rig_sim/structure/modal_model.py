"""Modes of a structure as a state space: force in, acceleration out; sampled exactly, and its FRF in closed form.

Each mode has q'' + 2 ζ ω q' + ω² q = Φ_d u with mass-normalised shapes; a response is Σ Φ_r q''. Between samples the
force is linear, as on every rig of this house, so one matrix exponential a mode says exactly what follows a sample: no
error of integration, at any damping.

Source: L. Ljung, System Identification, 2nd ed. 1999, section 2.1 (sampling); C.F. Van Loan, Computing integrals
involving the matrix exponential, IEEE Trans. Automatic Control 23 (1978).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class SampledModel:
    """x[k+1] = a x[k] + b0 u[k] + b1 u[k+1], y[k] = c x[k] + d u[k]; x is q and q' of each mode in turn.

    `a`: Transition over a sample. `b0`, `b1`: Effect of the drives at the sample's start, and at its end. `c`:
    Responses to the states. `d`: Direct responses to the drives.
    """

    a: np.ndarray
    b0: np.ndarray
    b1: np.ndarray
    c: np.ndarray
    d: np.ndarray


@dataclass(frozen=True)
class ModalModel:
    """Modes seen from the channels.

    `frequency`, `damping`: Undamped natural frequency in Hz and damping ratio. `at_drives`: Mass-normalised shapes
    where and along which the forces act, in 1/sqrt(kg). `at_responses`: The same where it is measured.
    """

    frequency: np.ndarray
    damping: np.ndarray
    at_drives: np.ndarray
    at_responses: np.ndarray

    def sampled(self, sample_rate: float) -> SampledModel:
        """Return the state space sampled at `sample_rate` in Hz."""
        modes, drives = len(self.frequency), len(self.at_drives)
        a = np.zeros((2 * modes, 2 * modes))
        b0, b1 = np.zeros((2, 2 * modes, drives))
        c = np.zeros((len(self.at_responses), 2 * modes))
        for index, (omega, damping) in enumerate(zip(2.0 * np.pi * self.frequency, self.damping, strict=True)):
            rows = slice(2 * index, 2 * index + 2)
            a[rows, rows], now, following = _sampled_mode(omega, damping, 1.0 / sample_rate)
            b0[rows] = np.outer(now, self.at_drives[:, index])
            b1[rows] = np.outer(following, self.at_drives[:, index])
            c[:, rows] = np.outer(self.at_responses[:, index], [-(omega**2), -2.0 * damping * omega])
        return SampledModel(a, b0, b1, c, self.at_responses @ self.at_drives.T)

    def sampled_frf(self, frequency: np.ndarray, sample_rate: float) -> Complex:
        """Return the FRF that a player of this model has, from drive samples to response samples.

        `frequency`: In Hz, 0 to half the sample rate. `sample_rate`: In Hz.
        Returns: In (m/s^2)/N. It differs from `continuous_frf` by the shape of the drive between samples.
        """
        z = np.exp(2j * np.pi * np.asarray(frequency) / sample_rate)
        frf = np.zeros((len(z), len(self.at_responses), len(self.at_drives)), dtype=np.complex128)
        frf += self.at_responses @ self.at_drives.T
        for index, (omega, damping) in enumerate(zip(2.0 * np.pi * self.frequency, self.damping, strict=True)):
            a, now, following = _sampled_mode(omega, damping, 1.0 / sample_rate)
            rhs = now[:, None] + following[:, None] * z
            # (z I - a)⁻¹ of a 2 × 2 matrix, written out.
            determinant = (z - a[0, 0]) * (z - a[1, 1]) - a[0, 1] * a[1, 0]
            place = ((z - a[1, 1]) * rhs[0] + a[0, 1] * rhs[1]) / determinant
            speed = (a[1, 0] * rhs[0] + (z - a[0, 0]) * rhs[1]) / determinant
            gain = -(omega**2) * place - 2.0 * damping * omega * speed
            frf += gain[:, None, None] * np.outer(self.at_responses[:, index], self.at_drives[:, index])
        return frf

    def continuous_frf(self, frequency: np.ndarray) -> Complex:
        """Return the FRF of the structure itself.

        `frequency`: In Hz.
        Returns: In (m/s^2)/N.
        """
        s = 2j * np.pi * np.asarray(frequency)[:, None]
        omega = 2.0 * np.pi * self.frequency
        gain = s**2 / (s**2 + 2.0 * self.damping * omega * s + omega**2)
        return np.einsum("om,fm,im->foi", self.at_responses, gain, self.at_drives)


def _sampled_mode(omega: float, damping: float, interval: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a (2, 2), b0 (2,), b1 (2,) of a mode of unit mass under a force that is linear over the interval."""
    augmented = np.zeros((4, 4))
    augmented[:2, :2] = [[0.0, interval], [-(omega**2) * interval, -2.0 * damping * omega * interval]]
    augmented[1, 2] = interval
    augmented[2, 3] = 1.0
    # Imported here: a multibody rig, which has no modes, shall not wait for scipy at its start.
    from scipy.linalg import expm

    solution = np.asarray(expm(augmented))
    hold, rise = solution[:2, 2], solution[:2, 3]
    return solution[:2, :2], hold - rise, rise
