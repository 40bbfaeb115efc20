"""Description of an identification as text."""

from __future__ import annotations

from typing import Final

from duralab_proto.v1 import identifier_pb2, iterator_pb2

_EXCITATIONS: Final = {
    identifier_pb2.EXCITATION_KIND_PURE_RANDOM: "pure random",
    identifier_pb2.EXCITATION_KIND_BURST_RANDOM: "burst random",
    identifier_pb2.EXCITATION_KIND_SWEPT_SINE: "swept sine",
    identifier_pb2.EXCITATION_KIND_PSEUDO_RANDOM: "pseudo-random, independent phases",
    identifier_pb2.EXCITATION_KIND_HADAMARD: "pseudo-random, Hadamard signs",
    identifier_pb2.EXCITATION_KIND_ORTHOGONAL_DFT: "orthogonal multisines",
    identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL: "full random orthogonal multisines",
}
_ESTIMATORS: Final = {
    identifier_pb2.ESTIMATOR_KIND_H1: "H1",
    identifier_pb2.ESTIMATOR_KIND_H2: "H2",
    identifier_pb2.ESTIMATOR_KIND_HV: "Hv",
    identifier_pb2.ESTIMATOR_KIND_LOCAL_POLYNOMIAL: "local polynomial method",
    identifier_pb2.ESTIMATOR_KIND_LOCAL_RATIONAL: "local rational method",
}
_MULTISINES: Final = frozenset(
    {
        identifier_pb2.EXCITATION_KIND_PSEUDO_RANDOM,
        identifier_pb2.EXCITATION_KIND_HADAMARD,
        identifier_pb2.EXCITATION_KIND_ORTHOGONAL_DFT,
        identifier_pb2.EXCITATION_KIND_RANDOM_ORTHOGONAL,
    }
)


def identification_in_words(
    excitation: identifier_pb2.Excitation,
    estimator: identifier_pb2.Estimator,
    at_target: iterator_pb2.AtTarget | None = None,
) -> str:
    """Return the experiments and the estimator as text."""
    second = ""
    if at_target is not None:
        second = f", then at {at_target.level:g} of the target's RMS, {at_target.duration:g} s"
    return (
        f"{_EXCITATIONS.get(excitation.kind, 'unknown')}, {_spectrum(excitation)}, "
        f"{excitation.duration:g} s{second}; {_ESTIMATORS.get(estimator.kind, 'unknown')}, "
        f"{_blocks(excitation, estimator)}"
    )


def _spectrum(excitation: identifier_pb2.Excitation) -> str:
    if excitation.drive_spectra:
        return "a spectrum for each drive"
    spectrum = excitation.spectrum
    band = f"{spectrum.lowest_frequency:g} to {spectrum.highest_frequency:g} Hz, flat"
    if spectrum.decibels_per_octave == 0.0:
        return band
    return f"{band} to {spectrum.corner_frequency:g} Hz, then −{spectrum.decibels_per_octave:g} dB per octave"


def _blocks(excitation: identifier_pb2.Excitation, estimator: identifier_pb2.Estimator) -> str:
    if excitation.kind in _MULTISINES:
        lines = ", odd lines only" if excitation.odd_lines else ""
        return (
            f"blocks of {estimator.block_samples} samples, {excitation.capture_blocks or 1} used of each experiment "
            f"after a delay of {excitation.delay_blocks or 1}{lines}"
        )
    if excitation.kind == identifier_pb2.EXCITATION_KIND_PURE_RANDOM:
        return f"Hann blocks of {estimator.block_samples} samples, {100 * estimator.overlap:g} % overlap"
    return f"blocks of {estimator.block_samples} samples"
