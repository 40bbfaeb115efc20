"""Estimation of an FRF from a record and its layout: whole, or piece by piece in bounded memory."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from duralab_settings import EstimatorKind
from duralab_spectra import NotFiniteError, as_record, shaped_record
from identifier.estimators.automatic_width import Widths, given_width, solve_widths, widths_to_try
from identifier.estimators.averaged_spectra import AveragedSpectra, SpectralSums
from identifier.estimators.condition import drive_condition, unit_diagonal
from identifier.estimators.frf_estimate import FrfEstimate, ModelWarning, WarningCode
from identifier.estimators.local_regression import DEFAULT_ORDER, LocalModel
from identifier.estimators.local_solution import LocalSolution, solve_local
from identifier.estimators.periodicity import PeriodicityCheck
from identifier.estimators.record_checks import ChannelCheck
from identifier.estimators.rest_check import RestCheck
from identifier.estimators.smoothing_check import (
    Neighbourhood,
    differences_from_h1,
    differences_from_narrower,
    few_equations,
)
from identifier.estimators.spectral import estimate_from_spectra, on_all_lines
from identifier.estimators.standstill import StandstillCheck
from identifier.estimators.used_stretches import UsedStretches
from identifier.layout import Layout, Window


@dataclass(frozen=True)
class EstimatorOptions:
    """Options of a local method; the spectral ones need only the layout.

    Parameters
    ----------
    order
        Order of numerator, transient and denominator, 0 or more; None for 2.
    half_width
        Lines of a segment to either side; None: the width with the smallest expected error at each line, see
        `solve_widths`.
    segment_blocks
        Number of blocks in a segment of noise, 1 or more.

    Raises
    ------
    ValueError
        A value is outside its range.
    """

    order: int | None = None
    half_width: int | None = None
    segment_blocks: int = 16

    def __post_init__(self) -> None:
        if self.segment_blocks < 1:
            raise ValueError(f"There are {self.segment_blocks} blocks in a segment; there must be 1 or more.")


class Estimation:
    """An estimate in progress: gets the whole record in order, in pieces of any size.

    Parameters
    ----------
    kind
        Estimator.
    layout
        Layout of the experiment.
    drives, responses
        Number of channels, 1 or more.
    options
        Options of the local methods.
    taken_off
        Shapes (drives) and (responses): offsets removed from the channels before, used in messages; zero where
        not given.

    Raises
    ------
    ValueError
        The options do not suit the record.
    """

    def __init__(
        self,
        kind: EstimatorKind,
        layout: Layout,
        *,
        drives: int,
        responses: int,
        options: EstimatorOptions,
        taken_off: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> None:
        if kind is EstimatorKind.H2 and drives != responses:
            raise ValueError(
                f"There are {responses} responses and {drives} drives; H2 inverts S_uy and needs as many of both: "
                "take H1 or Hv."
            )
        self._kind, self._layout = kind, layout
        self._spectral = SpectralSums(layout, drives=drives, responses=responses, full=kind is EstimatorKind.H2)
        self._widths, self._automatic = None, options.half_width is None
        if kind.is_local:
            order = DEFAULT_ORDER if options.order is None else options.order
            model = LocalModel(
                order=order,
                denominator_order=order if kind is EstimatorKind.LOCAL_RATIONAL else 0,
                half_width=1 if options.half_width is None else options.half_width,
                segment_blocks=options.segment_blocks,
            )
            choose = widths_to_try if self._automatic else given_width
            self._widths = choose(layout, drives=drives, responses=responses, model=model)
        self._used = UsedStretches(layout)
        of_drives, of_responses = taken_off or (None, None)
        self._drive_check = ChannelCheck(drives, name="drive", of_drive=True, taken_off=of_drives)
        self._response_check = ChannelCheck(responses, name="response", of_drive=False, taken_off=of_responses)
        self._standstill = StandstillCheck(layout, responses=responses, taken_off=of_responses)
        self._periodicity = PeriodicityCheck(layout, responses=responses)
        self._rest = RestCheck(layout, drives=drives, responses=responses)

    def add(self, drive: ArrayLike, response: ArrayLike) -> None:
        """Add the next samples.

        Parameters
        ----------
        drive
            Shape (drives, samples), as played, fades and delay blocks included.
        response
            Shape (responses, samples), as measured at the same instants.

        Raises
        ------
        ValueError
            The shapes do not agree, a value is not finite, or the record is longer than its layout; start again with
            the whole record then.
        """
        inputs, outputs = shaped_record(drive, name="drive"), shaped_record(response, name="response")
        _require_same_length(inputs, outputs)
        try:
            self._check(inputs, outputs)
        except NotFiniteError:
            # These checks report the value.
            as_record(inputs, name="drive")
            as_record(outputs, name="response")
            raise
        self._spectral.add(inputs, outputs)
        for sums in self._widths.regressions if self._widths else ():
            sums.add(inputs, outputs)
        self._periodicity.add(outputs)

    def _check(self, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> None:
        """Check every value once: used samples through their extremes, the delay blocks and fades between directly."""
        seen, first = 0, self._used.position
        for _, piece, _ in self._used.next_pieces(inputs.shape[1]):
            _require_finite(inputs[:, seen : piece.start], outputs[:, seen : piece.start])
            self._drive_check.add(inputs[:, piece])
            self._response_check.add(outputs[:, piece])
            self._standstill.add(inputs[:, piece], outputs[:, piece], first=first + piece.start)
            self._rest.add(inputs[:, piece], outputs[:, piece])
            seen = piece.stop
        _require_finite(inputs[:, seen:], outputs[:, seen:])

    def estimate(self) -> FrfEstimate:
        """Return the estimate from the whole record.

        Returns
        -------
        FrfEstimate
            Estimate with every warning about the record.

        Raises
        ------
        ValueError
            The record is not complete, a channel is dead, or it does not identify the rig.
        """
        if self._used.position < self._layout.samples:
            raise ValueError(
                f"The record has {self._used.position} samples, its layout {self._layout.samples}; "
                "estimate from the whole record of the drive that was played."
            )
        checks = (self._drive_check, self._response_check, self._standstill, self._periodicity, self._rest)
        warnings = tuple(warning for check in checks for warning in check.warnings())
        spectra = self._spectral.averages()
        if self._widths is None:
            return estimate_from_spectra(self._kind, spectra, warnings=warnings)
        return self._local_estimate(self._widths, spectra, warnings)

    def _local_estimate(
        self, widths: Widths, spectra: AveragedSpectra, warnings: tuple[ModelWarning, ...]
    ) -> FrfEstimate:
        lines, size = np.flatnonzero(spectra.lines), spectra.frequency.size
        scale, scaled = unit_diagonal(spectra.s_uu[lines], spectra.frequency[lines])
        condition = drive_condition(scaled, spectra.frequency[lines])
        if self._automatic:
            solution, half_width = solve_widths(widths, spectra)
        else:
            sums = widths.candidates[0]
            solution, half_width = solve_local(sums), np.full(lines.size, sums.model.half_width)
        warnings += few_equations(widths.candidates[0])
        warnings += self._smoothing_warnings(widths, spectra, solution, half_width, warnings)
        # Number of averages that would give H1 the same variance, averaged over the drives.
        of_h1 = np.einsum("fjj->fj", np.linalg.inv(scaled)).real
        averages = np.sum(of_h1, axis=1) / np.sum(solution.drive_weight * scale**2, axis=1)
        return FrfEstimate(
            frequency=spectra.frequency,
            frf=on_all_lines(solution.frf, lines, size),
            coherence=on_all_lines(solution.explained, lines, size),
            condition_number=on_all_lines(condition, lines, size),
            s_uu=spectra.s_uu,
            response_psd=spectra.auto_y,
            blocks=spectra.blocks,
            independent_averages=spectra.independent_averages,
            valid=spectra.lines.copy(),
            residual_psd=on_all_lines(solution.residual_psd, lines, size),
            degrees_of_freedom=on_all_lines(solution.degrees_of_freedom, lines, size),
            averages=on_all_lines(averages, lines, size),
            kind=self._kind,
            half_width=on_all_lines(half_width, lines, size),
            warnings=warnings,
        )

    def _smoothing_warnings(
        self,
        widths: Widths,
        spectra: AveragedSpectra,
        solution: LocalSolution,
        half_width: NDArray[np.int64],
        warnings: tuple[ModelWarning, ...],
    ) -> tuple[ModelWarning, ...]:
        sums = widths.candidates[0]
        neighbourhood = Neighbourhood.of(sums)
        if self._layout.window is Window.NONE:
            if self._automatic:
                # H1 is used at every line where the local method has the larger expected error.
                return ()
            transients = np.zeros(sums.responses)
            for warning in warnings:
                if warning.code is WarningCode.TRANSIENT and warning.channel is not None:
                    transients[warning.channel] = warning.size or 0.0
            other_phases = len({capture.realisation for capture in self._layout.captures}) > 1
            return differences_from_h1(
                spectra,
                solution,
                neighbourhood,
                transients=transients,
                other_phases=other_phases,
                sweeps=not self._layout.periodic and not other_phases,
            )
        if widths.narrower is None:
            return ()
        return differences_from_narrower(
            spectra,
            solution,
            neighbourhood,
            narrower=solve_local(widths.narrower),
            share=widths.narrower.model.half_width / half_width,
            bias_order=2 * (sums.model.order // 2) + 2,
        )


def estimate(
    kind: EstimatorKind,
    drive: ArrayLike,
    response: ArrayLike,
    layout: Layout,
    options: EstimatorOptions | None = None,
    *,
    taken_off: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> FrfEstimate:
    """Estimate an FRF matrix from the record of an experiment.

    Parameters
    ----------
    kind
        Estimator.
    drive
        Shape (drives, samples), as played, fades and delay blocks included.
    response
        Shape (responses, samples), as measured.
    layout
        Layout of the drive.
    options
        Options of the local methods; their defaults if None.
    taken_off
        See `Estimation`.

    Returns
    -------
    FrfEstimate
        Estimate at the excited lines, 0 elsewhere.

    Raises
    ------
    ValueError
        The record does not fit the layout, is not finite, has a dead channel, or does not identify the rig.

    Notes
    -----
    Source: Cornelis et al., ISMA 2014, Eq. 1; Pintelon & Schoukens, *System Identification*, chapters 2 and 7.
    """
    inputs, outputs = np.atleast_2d(drive), np.atleast_2d(response)
    running = Estimation(
        kind,
        layout,
        drives=inputs.shape[0],
        responses=outputs.shape[0],
        options=options or EstimatorOptions(),
        taken_off=taken_off,
    )
    running.add(inputs, outputs)
    return running.estimate()


def _require_finite(*records: NDArray[np.float64]) -> None:
    if not all(np.isfinite(record).all() for record in records):
        raise NotFiniteError


def _require_same_length(drive: NDArray[np.float64], response: NDArray[np.float64]) -> None:
    if drive.shape[1] != response.shape[1]:
        raise ValueError(
            f"{drive.shape[1]} samples were played and {response.shape[1]} measured; a playback gives as many back."
        )
