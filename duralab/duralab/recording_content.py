"""What a recording holds, decoded: playbacks, the model, the use of the actuators."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from duralab.signals import Channel, Signals, channels_of
from duralab_proto.arrays import from_array
from duralab_proto.v1 import identifier_pb2, iterator_pb2, rig_pb2

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class ActuatorUse:
    """How one actuator was used in a playback; see `duralab.v1.ActuatorUse`.

    Parameters
    ----------
    drive : str
        The drive's name.
    peak_command_ratio : float
        Largest magnitude of the drive over the limit in that direction, 0 to 1.
    saturated_share : float
        Share of the time in which the valve was at its stop or the load pressure at its limit, 0 to 1.
    largest_following_error : float
        Largest difference of command and achieved value, in the drive's unit.
    largest_load_pressure_share : float
        Largest load pressure over what the supply could press with at that moment, 0 to 1; 1 is a stall. Zero, as the
        next one, in recordings made before it was measured.
    lowest_supply_pressure : float
        Of the actuator's supply, in Pa.
    """

    drive: str
    peak_command_ratio: float
    saturated_share: float
    largest_following_error: float
    largest_load_pressure_share: float = 0.0
    lowest_supply_pressure: float = 0.0

    @property
    def tells_of_a_valve(self) -> bool:
        """Whether the rig has a valve and a supply there, as far as it tells: one without leaves their figures at 0."""
        return any((self.saturated_share, self.largest_load_pressure_share, self.lowest_supply_pressure))

    @property
    def tells_what_was_achieved(self) -> bool:
        """Whether the achieved value was compared with the command: an actuator never follows to the last bit."""
        return self.largest_following_error != 0.0


def actuator_use(messages: Iterable[rig_pb2.ActuatorUse]) -> tuple[ActuatorUse, ...]:
    """Decode how the actuators were used, in the order of the drives."""
    return tuple(
        ActuatorUse(
            drive=message.drive,
            peak_command_ratio=message.peak_command_ratio,
            saturated_share=message.saturated_share,
            largest_following_error=message.largest_following_error,
            largest_load_pressure_share=message.largest_load_pressure_share,
            lowest_supply_pressure=message.lowest_supply_pressure,
        )
        for message in messages
    )


@dataclass(frozen=True)
class BandNote:
    """What signals of a recording are, and whether they are in the control band: targets and responses differ in it.

    Parameters
    ----------
    quantity : str
        "target", "response" or "error".
    in_band : bool
        Whether they are as they are judged: in the control band, without their static part.
    lowest_frequency, highest_frequency : float
        Edges of the control band, in hertz.
    level : str
        How a playback at partial level is scaled; empty for a target.
    """

    quantity: str
    in_band: bool
    lowest_frequency: float
    highest_frequency: float
    level: str = ""

    @property
    def band(self) -> str:
        """The value of the coordinate `band`."""
        return "in band" if self.in_band else "as measured"

    @property
    def attributes(self) -> dict[str, str | float]:
        """What labelled arrays say of themselves in their attributes; the edges are those of in-band signals only."""
        edges = {"lowest_frequency": self.lowest_frequency, "highest_frequency": self.highest_frequency}
        return {
            "quantity": self.quantity,
            "band": self.band,
            **(edges if self.in_band else {}),
            "static_part": "removed" if self.in_band else "kept",
            **({"level": self.level} if self.level else {}),
        }


def response_note(specification: iterator_pb2.CampaignSpec, *, in_band: bool, quantity: str = "response") -> BandNote:
    """Return the note of the responses of a campaign."""
    return BandNote(
        quantity,
        in_band,
        specification.lowest_frequency,
        specification.highest_frequency,
        level="divided by the level of the playback" if in_band else "as played",
    )


def target_note(specification: iterator_pb2.CampaignSpec, *, in_band: bool) -> BandNote:
    """Return the note of the target of a campaign."""
    return BandNote("target", in_band, specification.lowest_frequency, specification.highest_frequency)


@dataclass(frozen=True, eq=False, repr=False)
class RecordedSignals(Signals):
    """Signals of a recording whose labelled arrays refuse to be mixed with those of another band.

    Parameters
    ----------
    note : BandNote
        What they are.
    """

    note: BandNote = field(kw_only=True)

    def to_xarray(self, name: str = "signals") -> xarray.DataArray:
        """Return a labelled array as `Signals.to_xarray` does, with the coordinate `band` and attributes.

        Parameters
        ----------
        name : str
            Of the array.

        Returns
        -------
        xarray.DataArray
            A difference of arrays of which one is in band and the other as measured raises InputError.
        """
        from duralab.recording_arrays import marked

        return marked(super().to_xarray(name), self.note)


@dataclass(frozen=True, eq=False, repr=False)
class RecordedTarget(RecordedSignals):
    """The target of a recording: signals in the control band; called, a dataset in the layout of the responses.

    Parameters
    ----------
    dataset : callable
        Makes that dataset.
    """

    dataset: Callable[[bool], xarray.Dataset] = field(kw_only=True)

    def __call__(self, *, in_band: bool) -> xarray.Dataset:
        """Return the target in the layout of `Recording.responses`: a variable for each channel over `time`.

        Parameters
        ----------
        in_band : bool
            True for the target as it is judged, False for the target as it was given, with its static part and what is
            outside the control band.

        Returns
        -------
        xarray.Dataset
            The difference with `responses(in_band=...)` of another band is refused.

        Raises
        ------
        InputError
            `in_band` is neither True nor False.
        """
        return self.dataset(in_band)


@dataclass(frozen=True, eq=False)
class Playback:
    """One playback of the target's drive.

    Parameters
    ----------
    number : int
        From 1.
    run : str
        Its name on the rig.
    drive, response : Signals
        What was played and what was measured.
    response_in_band : Signals
        The response as it is judged: in the control band, without its static part, divided by `level`.
    actuators : tuple of ActuatorUse
        One for each drive.
    level : float
        Share of the target that was played for, above 0 to 1.
    """

    number: int
    run: str
    drive: Signals
    response: Signals
    response_in_band: Signals
    actuators: tuple[ActuatorUse, ...]
    level: float = 1.0

    def __repr__(self) -> str:
        """Return it on one line, without arrays."""
        return f"Playback({self.number}, {self.run}: {self.response!r})"

    def __str__(self) -> str:
        """Return it as a table."""
        from duralab.showing.values import playback_text

        return playback_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.values import playback_html

        return playback_html(self)


@dataclass(frozen=True, eq=False)
class Distortion:
    """What of a response is nonlinear and what is noise, from an experiment that tells them apart.

    Parameters
    ----------
    noise_psd, distortion_psd : np.ndarray, shape (lines, responses)
        Density of the noise and of the stochastic nonlinear distortion, unit²/Hz; the latter is a difference of two
        estimates and may lie below 0 where there is none, as may the next two.
    odd_distortion_psd, even_distortion_psd : np.ndarray, shape (lines, responses) or (0, responses)
        Of the detection lines of odd and even orders; empty where the excitation leaves none out.
    distortion_share, noise_share : np.ndarray, shape (responses)
        RMS over that of the response in the band.
    """

    noise_psd: np.ndarray
    distortion_psd: np.ndarray
    odd_distortion_psd: np.ndarray
    even_distortion_psd: np.ndarray
    distortion_share: np.ndarray
    noise_share: np.ndarray

    @classmethod
    def from_message(cls, message: identifier_pb2.Distortion, *, lines: int, responses: int) -> Distortion:
        """Decode what was found."""

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
    """An identified rig: `H` in y(f) = H(f) u(f), with e^{+jωt}.

    Parameters
    ----------
    id : str
        SHA-256 of the model.
    drives, responses : tuple of Channel
        Inputs and outputs of `frf`.
    frequency : np.ndarray, shape (lines)
        In hertz.
    frf : np.ndarray, shape (lines, responses, drives)
        Complex, response unit per drive unit; NaN at lines where nothing was estimated, like its deviation, the
        coherence and the condition number.
    coherence : np.ndarray, shape (lines, responses)
        Multiple coherence, 0 to 1.
    condition_number : np.ndarray, shape (lines)
        Of the drives' cross-spectrum, scaled to unit diagonal.
    drive_psd, response_psd : np.ndarray, shape (lines, drives) and (lines, responses)
        Auto-spectra, unit²/Hz.
    blocks : int
        Blocks averaged.
    independent_averages : float
        Equivalent independent averages.
    frf_deviation : np.ndarray, shape (lines, responses, drives)
        Standard deviation of each element of `frf`; 0 where it is not known, as in older recordings.
    verdicts : tuple of str
        How linear each response is, in words; empty in older recordings.
    warnings : tuple of str
        What the identifier found suspicious, in words.
    distortion : Distortion or None
        None where the experiment does not tell noise and nonlinearity apart.
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

    @classmethod
    def from_message(cls, message: identifier_pb2.Model) -> Model:
        """Decode a model; where nothing was estimated it says nothing: NaN."""
        lines = len(from_array(message.frequency, field="frequency", shape=(None,)))
        n_y, n_u = len(message.responses), len(message.drives)

        def spectrum(name: str, *columns: int) -> np.ndarray:
            return from_array(getattr(message, name), field=name, shape=(lines, *columns), finite=False)

        # A condition number is 1 or more: the 0 is the identifier's word for a line outside the band.
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
        )

    def to_xarray(self) -> xarray.Dataset:
        """Return frf, its deviation, coherence and condition number over `frequency`, `response` and `drive`.

        Returns
        -------
        xarray.Dataset
            NaN where nothing was estimated. What is what and its unit are in the attributes `long_name` and `units`;
            where elements of `frf` differ in it, the coordinates `response_unit` and `drive_unit` tell each one's.
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
        """Return it on one line, without arrays."""
        return f"Model({self.id[:12]}: {len(self.responses)} responses, {len(self.drives)} drives)"

    def __str__(self) -> str:
        """Return it as a table."""
        from duralab.showing.models import model_text

        return model_text(self)

    def _repr_html_(self) -> str:
        from duralab.showing.models import model_html

        return model_html(self)


def level_of(step: iterator_pb2.IterationStep) -> float:
    """Return the level of a playback; older recordings tell none and are at 1."""
    return step.level or 1.0


def playback_of(step: iterator_pb2.IterationStep, specification: iterator_pb2.CampaignSpec) -> Playback:
    """Decode a playback of a campaign; raises ArrayError where its arrays do not fit together."""
    response = Signals.from_message(step.response, field="response")
    in_band = from_array(step.response_in_band, field="response_in_band", shape=response.samples.shape)

    def noted(samples: np.ndarray, *, in_band: bool) -> RecordedSignals:
        note = response_note(specification, in_band=in_band)
        return RecordedSignals(response.channels, response.sample_rate, samples, note=note)

    return Playback(
        number=step.iteration,
        run=step.run,
        drive=Signals.from_message(step.drive, field="drive"),
        response=noted(response.samples, in_band=False),
        response_in_band=noted(in_band, in_band=True),
        actuators=actuator_use(step.actuators),
        level=level_of(step),
    )
