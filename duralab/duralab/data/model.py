"""Identified model: frequency responses, their uncertainty and their distortion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Final

import numpy as np

from duralab.data.signals import Channel, channels_of
from duralab.display import MOST_CHARTS, Axis, Curve, html_table, line_chart, text_table
from duralab_proto.arrays import from_array
from duralab_proto.v1 import identifier_pb2

if TYPE_CHECKING:
    import xarray

FREQUENCY_AXIS: Final = Axis("frequency [Hz]", logarithmic=True)

_SMALLEST_LEVEL: Final = 1e-3
"""Smallest share of the strongest line's drive density at which a line counts as excited."""

_MODEL: Final = ("response", "unit", "lowest coherence", "median coherence", "relative deviation of its FRF")


@dataclass(frozen=True, eq=False)
class Distortion:
    """Nonlinear distortion and noise of the responses, from an experiment that separates them.

    `noise_psd`, `distortion_psd`, shape (lines, responses): Density of the noise and of the stochastic nonlinear
    distortion, unit²/Hz; the latter is a difference of two estimates and may be below 0 without distortion, as may the
    next two. `odd_distortion_psd`, `even_distortion_psd`, shape (lines, responses) or (0, responses): Density at the
    detection lines of odd and even orders; empty if the excitation has no detection lines. `distortion_share`,
    `noise_share`, shape (responses): RMS over that of the response in the band.
    """

    noise_psd: np.ndarray
    distortion_psd: np.ndarray
    odd_distortion_psd: np.ndarray
    even_distortion_psd: np.ndarray
    distortion_share: np.ndarray
    noise_share: np.ndarray

    @classmethod
    def from_message(cls, message: identifier_pb2.Distortion, *, lines: int, responses: int) -> Distortion:
        """Decode the distortion."""

        def densities(name: str) -> np.ndarray:
            if not message.HasField(name):
                return np.zeros((0, responses))
            return from_array(getattr(message, name), field=name, shape=(lines, responses), finite=False)

        return cls(
            noise_psd=densities("noise_psd"),
            distortion_psd=densities("distortion_psd"),
            odd_distortion_psd=densities("odd_distortion_psd"),
            even_distortion_psd=densities("even_distortion_psd"),
            distortion_share=from_array(message.distortion_share, field="distortion_share", shape=(responses,)),
            noise_share=from_array(message.noise_share, field="noise_share", shape=(responses,)),
        )


@dataclass(frozen=True, eq=False)
class Model:
    """Model of an identified rig: `H` in y(f) = H(f) u(f), with e^{+jωt}.

    Parameters
    ----------
    id : str
        SHA-256 of the model.
    drives, responses : tuple of Channel
        Inputs and outputs of `frf`.
    frequency : np.ndarray, shape (lines)
        Frequency lines in hertz.
    frf : np.ndarray, shape (lines, responses, drives)
        Complex, response unit per drive unit; NaN at lines where nothing was estimated, like its deviation, the
        coherence and the condition number.
    coherence : np.ndarray, shape (lines, responses)
        Multiple coherence, 0 to 1.
    condition_number : np.ndarray, shape (lines)
        Condition number of the drives' cross-spectrum, scaled to unit diagonal.
    drive_psd, response_psd : np.ndarray, shape (lines, drives) and (lines, responses)
        Auto-spectra, unit²/Hz.
    blocks : int
        Number of averaged blocks.
    independent_averages : float
        Equivalent number of independent averages.
    frf_deviation : np.ndarray, shape (lines, responses, drives)
        Standard deviation of each element of `frf`; 0 if unknown, as in older recordings.
    verdicts : tuple of str
        Linearity of each response, as text; empty in older recordings.
    warnings : tuple of str
        Warnings of the identifier.
    distortion : Distortion or None
        Distortion; None if the experiment does not separate noise and nonlinearity.
    drive_map : tuple of str
        Terms of drives that follow products of others, e.g. "lateral follows −1.71 /m × vertical²". If there is one,
        `frf` is from mapped drives to responses.
    static_gain : np.ndarray or None, shape (responses, drives)
        Gain at 0 Hz, response unit per drive unit; None if the experiment does not measure it.
    """

    id: str
    drives: tuple[Channel, ...]
    responses: tuple[Channel, ...]
    frequency: np.ndarray
    frf: np.ndarray
    coherence: np.ndarray
    condition_number: np.ndarray
    drive_psd: np.ndarray
    response_psd: np.ndarray
    blocks: int
    independent_averages: float
    frf_deviation: np.ndarray
    verdicts: tuple[str, ...]
    warnings: tuple[str, ...]
    distortion: Distortion | None = None
    drive_map: tuple[str, ...] = ()
    static_gain: np.ndarray | None = None

    @classmethod
    def from_message(cls, message: identifier_pb2.Model) -> Model:
        """Decode a model; values that were not estimated are NaN."""
        lines = len(from_array(message.frequency, field="frequency", shape=(None,)))
        n_y, n_u = len(message.responses), len(message.drives)

        def spectrum(name: str, *columns: int) -> np.ndarray:
            return from_array(getattr(message, name), field=name, shape=(lines, *columns), finite=False)

        # A condition number is 1 or more; the identifier sets 0 at lines outside the band.
        unknown = spectrum("condition_number") == 0.0

        def estimated(name: str, *columns: int) -> np.ndarray:
            return np.where(unknown.reshape(-1, *(1,) * len(columns)), np.nan, spectrum(name, *columns))

        return cls(
            id=message.id,
            drives=channels_of(message.drives),
            responses=channels_of(message.responses),
            frequency=spectrum("frequency"),
            frf=estimated("frf", n_y, n_u),
            coherence=estimated("coherence", n_y),
            condition_number=estimated("condition_number"),
            drive_psd=spectrum("drive_psd", n_u),
            response_psd=spectrum("response_psd", n_y),
            blocks=message.blocks,
            independent_averages=message.independent_averages,
            frf_deviation=(
                np.sqrt(estimated("frf_variance", n_y, n_u))
                if message.HasField("frf_variance")
                else np.zeros((lines, n_y, n_u))
            ),
            verdicts=tuple(message.verdicts),
            warnings=tuple(warning.sentence for warning in message.warnings),
            distortion=(
                Distortion.from_message(message.distortion, lines=lines, responses=n_y)
                if message.HasField("distortion")
                else None
            ),
            drive_map=tuple(term.sentence for term in message.drive_map.terms),
            static_gain=(
                from_array(message.static_gain, field="static_gain", shape=(n_y, n_u))
                if message.HasField("static_gain")
                else None
            ),
        )

    def to_xarray(self) -> xarray.Dataset:
        """Return frf, its deviation, coherence and condition number over `frequency`, `response` and `drive`.

        Returns
        -------
        xarray.Dataset
            Arrays, NaN where nothing was estimated. The attributes `long_name` and `units` give description and unit;
            if the units of elements of `frf` differ, the coordinates `response_unit` and `drive_unit` give the unit of
            each.
        """
        import xarray

        units = {f"{response.unit}/{drive.unit}" for response in self.responses for drive in self.drives}
        of_frf = {"units": units.pop() if len(units) == 1 else "response_unit/drive_unit"}
        elements = ("frequency", "response", "drive")
        return xarray.Dataset(
            {
                "frf": (elements, self.frf, {"long_name": "frequency response", **of_frf}),
                "frf_deviation": (
                    elements,
                    self.frf_deviation,
                    {"long_name": "standard deviation of the frequency response", **of_frf},
                ),
                "coherence": (elements[:2], self.coherence, {"long_name": "multiple coherence", "units": "1"}),
                "condition_number": (
                    elements[:1],
                    self.condition_number,
                    {
                        "long_name": "condition number of the drives' cross-spectrum, scaled to unit diagonal",
                        "units": "1",
                    },
                ),
            },
            coords={
                "frequency": ("frequency", self.frequency, {"units": "Hz"}),
                "response": [channel.name for channel in self.responses],
                "drive": [channel.name for channel in self.drives],
                "response_unit": ("response", [channel.unit for channel in self.responses]),
                "drive_unit": ("drive", [channel.unit for channel in self.drives]),
            },
            attrs={"id": self.id},
        )

    def __repr__(self) -> str:
        """Return a one-line description without arrays."""
        return f"Model({self.id[:12]}: {len(self.responses)} responses, {len(self.drives)} drives)"

    def __str__(self) -> str:
        """Return a table as text."""
        return model_text(self)

    def _repr_html_(self) -> str:

        return model_html(self)


def excited_lines(model: Model) -> np.ndarray:
    """Return the lines that the experiment excited; at other lines the estimate is noise over noise.

    `model`: Identified model.
    Returns: Mask of shape (lines), True at excited lines.
    """
    level = np.nan_to_num(model.drive_psd).max(axis=1)
    known = np.abs(np.nan_to_num(model.frf)).max(axis=(1, 2)) > 0.0
    return (level > _SMALLEST_LEVEL * level.max()) & known & (model.frequency > 0.0)


def _model_rows(model: Model) -> list[tuple[str, ...]]:
    lines = excited_lines(model)
    rows = []
    for i, channel in enumerate(model.responses):
        coherence = model.coherence[lines, i]
        size = np.linalg.norm(model.frf[lines, i], axis=1)
        deviation = np.median(np.linalg.norm(model.frf_deviation[lines, i], axis=1) / size) if lines.any() else np.nan
        known = np.isfinite(deviation) and deviation > 0.0
        low, middle = (np.min(coherence), np.median(coherence)) if lines.any() else (np.nan, np.nan)
        shown = f"{100 * deviation:.1f} %" if known else "–"
        rows.append((channel.name, channel.unit, f"{low:.3f}", f"{middle:.3f}", shown))
    return rows


def _model_title(model: Model) -> str:
    frequency = model.frequency[excited_lines(model)]
    band = f"{frequency.min():.2g} to {frequency.max():.3g} Hz, {frequency.size} lines" if frequency.size else "no line"
    return (
        f"FRF of {len(model.responses)} responses and {len(model.drives)} drives: {band}, "
        f"{model.independent_averages:.1f} independent averages"
    )


def model_text(model: Model) -> str:
    """Return coherence and uncertainty of each response, and the verdicts, as text."""
    sentences = "".join(f"\n- {sentence}" for sentence in _sentences(model))
    return f"{_model_title(model)}\n{text_table(_MODEL, _model_rows(model), left=2)}{sentences}"


def _sentences(model: Model) -> tuple[str, ...]:
    terms = (f"Drive map: {'; '.join(model.drive_map)}.",) if model.drive_map else ()
    return (*terms, *model.verdicts, *model.warnings)


def model_html(model: Model) -> str:
    """Return a model's table as HTML, with the magnitude of the FRF and the coherence."""
    lines = excited_lines(model)
    frequency = model.frequency[lines]
    charts = [
        line_chart(
            [
                Curve(drive.title, frequency, np.abs(model.frf[lines, i, j]))
                for j, drive in enumerate(model.drives[:MOST_CHARTS])
            ],
            x=FREQUENCY_AXIS,
            y=Axis(f"|H| [{response.unit} per drive unit]", logarithmic=True),
            title=response.title,
        )
        for i, response in enumerate(model.responses[:MOST_CHARTS])
    ]
    if len(model.responses) > MOST_CHARTS or len(model.drives) > MOST_CHARTS:
        charts.append(f"<p>Drawn are the first {MOST_CHARTS} responses and drives.</p>")
    coherence = [
        Curve(response.title, frequency, model.coherence[lines, i])
        for i, response in enumerate(model.responses[:MOST_CHARTS])
    ]
    charts.append(line_chart(coherence, x=FREQUENCY_AXIS, y=Axis("multiple coherence"), from_zero=True))
    table = html_table(_MODEL, _model_rows(model), left=2, caption=_model_title(model))
    return f"{table}{_list(_sentences(model))}{''.join(charts)}"


def _list(sentences: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else ""
