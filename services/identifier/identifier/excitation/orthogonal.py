"""Sets of multisines: the phases shared by drives and experiments, and the decorrelation of the drives."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from duralab_settings import ExcitationKind
from identifier.excitation.hadamard import nearest_hadamard_order, sign_matrix
from identifier.excitation.random_streams import Purpose, random_stream


@dataclass(frozen=True)
class PhaseSet:
    """Phases of one realisation: drive i in experiment c has ``rows_i mixing_ic columns_c`` at each line.

    All factors have magnitude 1, so the amplitudes of the lines alone determine PSD and level.

    `mixing`: Complex, shape (drives, experiments); orthogonal rows make `S_uu` diagonal over the set. `rows`: Complex,
    shape (drives or 1, 1, lines); 1 if all drives share one block. `columns`: Complex, shape (1, experiments or 1,
    lines); 1 if the experiments share their phases.
    """

    mixing: NDArray[np.complex128]
    rows: NDArray[np.complex128]
    columns: NDArray[np.complex128]

    def lines(self, amplitude: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the complex amplitudes of every drive in every experiment.

        `amplitude`: Shape (drives, lines).
        Returns: Shape (drives, experiments, lines).
        """
        return amplitude[:, None, :] * self.mixing[:, :, None] * self.rows * self.columns


def dft_matrix(order: int) -> NDArray[np.complex128]:
    """Return the matrix of the roots of unity, with orthogonal rows for every order.

    `order`: 1 or more.
    Returns: Complex, shape (order, order).
    """
    index = np.arange(order)
    # The product is reduced before the conversion to an angle, so that high orders lose no digits.
    return np.exp(2j * np.pi * ((index[:, None] * index[None, :]) % order) / order)


def experiments_of(kind: ExcitationKind, drives: int) -> int:
    """Return the number of experiments in one realisation of a multisine kind."""
    if kind is ExcitationKind.PSEUDO_RANDOM:
        return 1
    return nearest_hadamard_order(drives) if kind is ExcitationKind.HADAMARD else drives


def draw_phases(kind: ExcitationKind, *, drives: int, lines: int, realisation: int, seed: int) -> PhaseSet:
    """Draw the phases of one realisation.

    `kind`: A multisine kind. `RANDOM_ORTHOGONAL` is ``D_row(e^{j phi}) W D_col(e^{j psi})`` with `W` the DFT matrix,
    which exists for every number of drives, and new `phi` and `psi` for each realisation. `drives`: 1 or more. `lines`:
    Number of lines of the block grid. `realisation`: 0 or more. `seed`: Seed of the experiment.
    Returns: Phase set with phases uniform on the circle.
    Source: Dobrowiecki & Schoukens, "Measuring a linear approximation to weakly nonlinear MIMO systems", Automatica 43
    (2007); Cornelis et al., ISMA 2014, Eqs. 8 and 9, for the signs.
    """

    def phases(purpose: Purpose, count: int) -> NDArray[np.complex128]:
        streams = [random_stream(seed, purpose, realisation, index) for index in range(count)]
        return np.exp(2j * np.pi * np.stack([stream.random(lines) for stream in streams]))

    experiments = experiments_of(kind, drives)
    if kind is ExcitationKind.PSEUDO_RANDOM:
        mixing = np.ones((drives, 1), dtype=np.complex128)
    elif kind is ExcitationKind.HADAMARD:
        mixing = sign_matrix(drives).astype(np.complex128)
    else:
        mixing = dft_matrix(drives)
    shared = kind in (ExcitationKind.HADAMARD, ExcitationKind.ORTHOGONAL_DFT)
    rows = phases(Purpose.DRIVE_PHASES, 1 if shared else drives)[:, None, :]
    columns = np.ones((1, 1, lines), dtype=np.complex128)
    if kind is ExcitationKind.RANDOM_ORTHOGONAL and experiments > 1:
        columns = phases(Purpose.EXPERIMENT_PHASES, experiments)[None, :, :]
    return PhaseSet(mixing=mixing, rows=rows, columns=columns)
