"""YAML of a rig in an FMU: its file, its step, and the variable of each channel."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rig_sim.parameters import Finite, NotNegative, Positive
from rig_sim.specimen import InputChannel, Quantity, RigSpecimen, SensorChannel

KIND = "fmu"

FmuName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*\.fmu$")]
VariableName = Annotated[str, Field(min_length=1)]
#: Allowed difference of whole steps and a sample interval, as a share, because of the decimals in a YAML.
_ROUNDING = 1.0e-9


class FmuDrive(InputChannel):
    """A drive: an input of the FMU."""

    variable: VariableName


class FmuResponse(SensorChannel):
    """A response: an output of the FMU."""

    quantity: Quantity
    variable: VariableName


class FmuSpecimen(RigSpecimen):
    """A rig that an FMU simulates as a whole."""

    kind: Literal["fmu"]
    #: Name of the FMU, in the folder of the YAML.
    fmu: FmuName
    #: Communication step in s, a whole number of which is a sample interval; the sample interval if not given.
    step: Positive | None = None
    #: Time in s with all drives at zero before each playback, until it rests.
    settling: Annotated[NotNegative, Field(le=600.0)] = 0.0
    #: Values of parameters and of inputs without a drive, in the units of the FMU.
    start_values: dict[VariableName, Finite] = Field(default_factory=dict)
    drives: Annotated[tuple[FmuDrive, ...], Field(min_length=1)]
    responses: Annotated[tuple[FmuResponse, ...], Field(min_length=1)]

    @property
    def steps(self) -> int:
        """Number of communication steps in a sample interval."""
        return 1 if self.step is None else round(1.0 / (self.sample_rate * self.step))

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        driven = [channel.variable for channel in self.drives]
        for what, names in (
            ("drives are called", [channel.name for channel in self.drives]),
            ("responses are called", [channel.name for channel in self.responses]),
            ("drives move the variable", driven),
            ("responses are the variable", [channel.variable for channel in self.responses]),
        ):
            if twice := _repeated(names):
                raise ValueError(f"two {what} {twice!r}; each must have its own")
        if both := next((name for name in self.start_values if name in driven), None):
            raise ValueError(f"start_values has {both!r}, which a drive moves; leave it out there")
        if self.step is not None and not abs(self.steps * self.step * self.sample_rate - 1.0) < _ROUNDING:
            raise ValueError(
                f"step is {self.step:g} s; a whole number of steps must make a sample interval of "
                f"{1.0 / self.sample_rate:g} s"
            )
        return self


def _repeated(names: Iterable[str]) -> str | None:
    seen: set[str] = set()
    return next((name for name in names if name in seen or seen.add(name)), None)
