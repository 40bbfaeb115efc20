"""Faults injected for tests and rehearsals: of sensors, in the responses; of the hydraulics, for whole playbacks.

A rig with faults states so in its title and has another content hash, so that it is not mistaken for a healthy one.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import BaseModel, Field, ValidationError

from rig_sim.hydraulics import all_supplies
from rig_sim.parameters import STRICT, Finite, Name, NotNegative, Positive
from rig_sim.specimen import Specimen, SpecimenError, explain_problems

Share = Annotated[float, Field(gt=0.0, lt=1.0)]


class FaultKind(StrEnum):
    """Kind of a fault."""

    STUCK_SENSOR = "stuck_sensor"
    NOISY_SENSOR = "noisy_sensor"
    DRIFTING_GAIN = "drifting_gain"
    VALVE_SATURATION = "valve_saturation"
    SUPPLY_SAG = "supply_sag"


class _SensorFault(BaseModel):
    model_config = STRICT

    channel: str
    #: Time of a playback in s.
    start: NotNegative = 0.0


class StuckSensor(_SensorFault):
    """From `start` on, the channel keeps the value it had then."""

    kind: Literal[FaultKind.STUCK_SENSOR]

    @property
    def sentence(self) -> str:
        """Return a description as text."""
        return f"sensor {self.channel} stuck from {self.start:g} s"


class NoisySensor(_SensorFault):
    """From `start` on, the channel has more white noise, of `rms` in its unit."""

    kind: Literal[FaultKind.NOISY_SENSOR]
    rms: Positive
    #: Combined with the playback's seed.
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def sentence(self) -> str:
        """Return a description as text."""
        return f"sensor {self.channel} noisy by {self.rms:g} from {self.start:g} s"


class DriftingGain(_SensorFault):
    """From `start` on, the channel's gain is 1 + rate (t - start); `rate` in 1/s."""

    kind: Literal[FaultKind.DRIFTING_GAIN]
    rate: Finite

    @property
    def sentence(self) -> str:
        """Return a description as text."""
        return f"gain of sensor {self.channel} drifting by {self.rate:g} 1/s from {self.start:g} s"


class ValveSaturation(BaseModel):
    """The valves of one kind of actuator open at most to this share of full opening, for whole playbacks."""

    model_config = STRICT

    kind: Literal[FaultKind.VALVE_SATURATION]
    actuator_kind: str
    opening: Share

    @property
    def sentence(self) -> str:
        """Return a description as text."""
        return f"valves of kind {self.actuator_kind} open to {100.0 * self.opening:g} % only"


class SupplySag(BaseModel):
    """A supply reaches only this share of its pressure, for whole playbacks; every supply if none is named."""

    model_config = STRICT

    kind: Literal[FaultKind.SUPPLY_SAG]
    share: Share
    supply: Name | None = None

    @property
    def sentence(self) -> str:
        """Return a description as text."""
        which = "supply" if self.supply is None else f"supply {self.supply}"
        return f"{which} sagged to {100.0 * self.share:g} % of its pressure"


SensorFault = StuckSensor | NoisySensor | DriftingGain
Fault = Annotated[SensorFault | ValveSaturation | SupplySag, Field(discriminator="kind")]


def break_specimen(specimen: Specimen, faults: Sequence[Fault]) -> Specimen:
    """Return the specimen with the faults of its hydraulics, and a title that names all faults."""
    if not faults:
        return specimen
    document = specimen.model_dump()
    for fault in faults:
        match fault:
            case ValveSaturation():
                if fault.actuator_kind not in specimen.actuator_kinds:
                    raise _unknown(specimen.name, fault, fault.actuator_kind, list(specimen.actuator_kinds))
                document["actuator_kinds"][fault.actuator_kind]["valve"]["largest_opening"] *= fault.opening
            case SupplySag():
                supplies = all_supplies(document["supply"], document["supplies"])
                if not supplies:
                    raise SpecimenError(f"{specimen.name} has no supply; remove its fault {fault.kind}.")
                if fault.supply is not None and fault.supply not in supplies:
                    raise _unknown(specimen.name, fault, fault.supply, list(supplies))
                for name in supplies if fault.supply is None else (fault.supply,):
                    supplies[name]["supply_pressure"] *= fault.share
            case _:
                _check_channel(fault, rig=specimen.name, channels=[channel.name for channel in specimen.responses])
    document["title"] += title_suffix(faults)
    try:
        return Specimen.model_validate(document)
    except ValidationError as error:
        raise SpecimenError(
            f"{specimen.name} cannot be with these faults: {explain_problems(error, Specimen)}"
        ) from error


def sensor_faults(faults: Sequence[Fault], *, rig: str, channels: Sequence[str]) -> tuple[SensorFault, ...]:
    """Return the faults of a rig with sensors but without hydraulics."""
    broken: list[SensorFault] = []
    for fault in faults:
        if not isinstance(fault, SensorFault):
            raise SpecimenError(f"{rig} has no hydraulics; remove its fault {fault.kind}.")
        _check_channel(fault, rig=rig, channels=channels)
        broken.append(fault)
    return tuple(broken)


def title_suffix(faults: Sequence[Fault]) -> str:
    """Return the suffix of a rig's title for its faults; empty without faults."""
    return f" [FAULTS INJECTED: {'; '.join(fault.sentence for fault in faults)}]" if faults else ""


def _check_channel(fault: SensorFault, *, rig: str, channels: Sequence[str]) -> None:
    if fault.channel not in channels:
        raise _unknown(rig, fault, fault.channel, channels)


def _unknown(rig: str, fault: Fault, name: str, known: Sequence[str]) -> SpecimenError:
    return SpecimenError(f"fault {fault.kind} of {rig} names {name!r}; there are {', '.join(known) or 'none'}.")
