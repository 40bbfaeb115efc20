"""Convergence of Time Waveform Replication with a model's inverse, and its uncertainty (Eqs. 4 to 6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_spectra import as_frf, pseudo_inverse

CONFIDENCE = 0.95
"""Share of the rigs within the model's uncertainty, for `Convergence.spectral_radius_95`."""

DRAWS = 100
"""Number of rigs drawn from the model's uncertainty."""


@dataclass(frozen=True)
class Convergence:
    """Convergence of the error in one iteration, at each line.

    `frequency`: Shape (lines), in hertz. `spectral_radius`: Shape (lines): of ``I - H Hm^+ Q``, ``Hm`` the model, for
    the likeliest rig; it converges if and only if this is below 1. `spectral_radius_95`: Shape (lines): what 95 % of
    the rigs that the uncertainty allows stay below. `largest_singular_value`: Shape (lines): of the same matrix,
    responses scaled to their RMS; below 1 the error falls in every iteration. `converging_share`: Share of the rigs
    drawn that converge at every line, 0 to 1.
    """

    frequency: NDArray[np.float64]
    spectral_radius: NDArray[np.float64]
    spectral_radius_95: NDArray[np.float64]
    largest_singular_value: NDArray[np.float64]
    converging_share: float

    @property
    def sentence(self) -> str:
        """Finding as text."""
        line = int(np.argmax(self.spectral_radius_95))
        radius, bound = float(np.max(self.spectral_radius)), float(self.spectral_radius_95[line])
        where = f"{self.frequency[line]:.3g} Hz"
        if radius >= 1.0:
            line = int(np.argmax(self.spectral_radius))
            return (
                f"It will diverge at {self.frequency[line]:.3g} Hz, where the error grows by {radius:.3g} in each "
                "iteration; take smaller gains or identify again nearer to the operational level."
            )
        if bound >= 1.0:
            return (
                f"It converges if the model is right, by {radius:.3g} in each iteration, but may diverge at {where}: "
                f"{100 * self.converging_share:.0f} % of the rigs that its uncertainty allows converge everywhere; "
                "identify for longer or take smaller gains."
            )
        return (
            f"It converges: in the long run the error falls by the factor {bound:.3g} or more in each iteration, "
            f"slowest at {where}."
        )


def spectral_radius(rig: ArrayLike, *, model: ArrayLike, gain: ArrayLike) -> NDArray[np.float64]:
    """Return the spectral radius of ``I - H Hm^+ Q = I - [I + Hm (H^+ - Hm^+)]^-1 Q`` at each line (Eq. 6).

    ``Hm`` is the model. With more responses than drives it is that of the part of the error that the drives can reach.

    Parameters
    ----------
    rig
        Complex, shape (..., lines, responses, drives): the true FRF, one or several.
    model
        Complex, shape (lines, responses, drives), of full column rank at every line.
    gain
        Shape (responses): iteration gains, above 0 to 1.

    Returns
    -------
    numpy.ndarray
        Shape (..., lines), 0 or more.

    Raises
    ------
    ValueError
        A gain is not allowed or a shape does not fit.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eqs. 4 to 6. ``H Hm^+ Q`` and ``Hm^+ Q H`` share eigenvalues except zeros.
    """
    identified = as_frf(model, name="model")
    return _spectral_radius(np.asarray(rig, dtype=np.complex128), pseudo_inverse(identified), _gains(gain, identified))


def predict_convergence(
    frequency: ArrayLike,
    frf: ArrayLike,
    *,
    gain: ArrayLike,
    residual_psd: NDArray[np.float64],
    row_covariance: NDArray[np.complex128],
    response_rms: ArrayLike,
    rig: ArrayLike | None = None,
    seed: int = 0,
) -> Convergence:
    """Predict the convergence of an iteration with the inverse of a model on the rigs within its uncertainty.

    Parameters
    ----------
    frequency
        Shape (lines), in hertz: the lines of the control band only.
    frf
        Complex, shape (lines, responses, drives): the model.
    gain
        Shape (responses): iteration gains, above 0 to 1.
    residual_psd, row_covariance
        Shapes (lines, responses) and (lines, drives, drives): covariance of the model's rows, see `row_covariance`.
    response_rms
        Shape (responses), greater than 0: scale of each response's error, in the inverse and in the singular value.
    rig
        Complex, shape (lines, responses, drives): FRF that replaces the model as the rig, e.g. a model from another
        level; the uncertainty is drawn about it.
    seed
        Seed of the drawn rigs.

    Returns
    -------
    Convergence
        Convergence at the given lines.

    Raises
    ------
    ValueError
        A gain is not allowed or a shape does not fit.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eqs. 4 to 6; rows drawn as complex Gaussians of the covariance of Bendat &
    Piersol, *Random Data*, chapter 9.
    """
    weight = 1.0 / np.asarray(response_rms, dtype=np.float64)
    # Scaled rows: the pseudo-inverse of the scaled model is the weighted one, and singular values compare responses.
    model = as_frf(frf, name="frf") * weight[:, None]
    gains = _gains(gain, model)
    centre = model if rig is None else as_frf(rig, name="rig") * weight[:, None]
    if centre.shape != model.shape:
        raise ValueError(f"The rig has shape {centre.shape} and the model {model.shape}; both must be equal.")
    inverse = pseudo_inverse(model)
    factor = _square_root(row_covariance)
    deviation = np.sqrt(residual_psd) * weight
    generator = np.random.default_rng(seed)
    drawn = np.empty((DRAWS, model.shape[0]))
    for draw in range(DRAWS):
        normal = generator.standard_normal((2, *model.shape)) / np.sqrt(2.0)
        error = np.matmul(normal[0] + 1j * normal[1], factor.transpose(0, 2, 1)) * deviation[:, :, None]
        drawn[draw] = _spectral_radius(centre + error, inverse, gains)
    onto_reachable = np.matmul(model, inverse)
    step = np.eye(model.shape[1]) - np.matmul(centre, inverse) * gains
    reachable = np.matmul(np.matmul(onto_reachable, step), onto_reachable)
    return Convergence(
        frequency=np.asarray(frequency, dtype=np.float64),
        spectral_radius=_spectral_radius(centre, inverse, gains),
        spectral_radius_95=np.quantile(drawn, CONFIDENCE, axis=0),
        largest_singular_value=np.asarray(np.linalg.norm(reachable, 2, axis=(1, 2)), dtype=np.float64),
        converging_share=float(np.mean(np.all(drawn < 1.0, axis=1))),
    )


def _spectral_radius(
    rig: NDArray[np.complex128], inverse: NDArray[np.complex128], gain: NDArray[np.float64]
) -> NDArray[np.float64]:
    step = np.eye(inverse.shape[1]) - np.matmul(inverse * gain, rig)
    return np.max(np.abs(np.linalg.eigvals(step)), axis=-1)


def _gains(gain: ArrayLike, model: NDArray[np.complex128]) -> NDArray[np.float64]:
    gains = np.asarray(gain, dtype=np.float64)
    if gains.shape != (model.shape[1],) or not np.all((gains > 0.0) & (gains <= 1.0)):
        raise ValueError(
            f"The iteration gains are {gains.tolist()}; each of the {model.shape[1]} responses needs one above 0 to 1."
        )
    return gains


def _square_root(covariance: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return ``L`` with ``L L^H = C`` at each line; C is Hermitian, and may be 0."""
    deviation = np.sqrt(np.einsum("fjj->fj", covariance).real)
    size = np.where(deviation > 0.0, deviation, 1.0)
    # At unit diagonal: compared with a drive in newtons the variance of one in metres would be rounding.
    values, vectors = np.linalg.eigh(covariance / (size[:, :, None] * size[:, None, :]))
    # Rounding leaves eigenvalues of a positive matrix a little below 0.
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    # The phases of eigenvectors are arbitrary; the Hermitian root does not contain them.
    return size[:, :, None] * np.matmul(root, vectors.conj().transpose(0, 2, 1))
