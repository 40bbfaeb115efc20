"""Description of an FMU, checked against the YAML: platforms, variables, units and step."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any

import numpy as np

from rig_sim.fmu.specimen import FmuSpecimen
from rig_sim.specimen import SpecimenError

_MOST_NAMED = 12
_LONGEST_PROBLEM = 300
_BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd")
#: Exponents of the units of channels in the base units of `_BASE_UNITS`.
_EXPONENTS: Mapping[str, tuple[int, ...]] = {
    "m": (0, 1, 0, 0, 0, 0, 0),
    "m/s": (0, 1, -1, 0, 0, 0, 0),
    "m/s^2": (0, 1, -2, 0, 0, 0, 0),
    "N": (1, 1, -2, 0, 0, 0, 0),
    "N*m": (1, 2, -2, 0, 0, 0, 0),
    "1": (0, 0, 0, 0, 0, 0, 0),
}


@dataclass(frozen=True)
class Ports:
    """Variables of an FMU that are channels: value references, and an SI value as `factor` times theirs + `offset`."""

    references: tuple[int, ...]
    factor: np.ndarray
    offset: np.ndarray


@dataclass(frozen=True)
class FmuModel:
    """Description of an FMU with all data for a playback."""

    fmi: int
    identifier: str
    token: str
    drives: Ports
    responses: Ports
    #: Value references and values that are set before the initialisation.
    start_values: tuple[tuple[int, float], ...]


def read_model(path: Path, specimen: FmuSpecimen) -> FmuModel:
    """Read an FMU's model description and find the specimen's variables in it.

    Raises `SpecimenError` if it cannot be read, is of another kind or for other platforms, or a variable, a unit or
    the step does not fit; one sentence.
    """
    fmpy = _fmpy(specimen.name)
    try:
        with path.open("rb") as stream:
            with zipfile.ZipFile(stream) as archive:
                names = archive.namelist()
            description = fmpy.read_model_description(stream)
    except Exception as error:
        # For a damaged file any error may be raised.
        raise _refusal(specimen, f"{path.name} cannot be read: {_first_problem(error)}.") from error
    try:
        simulation = _co_simulation(description, path.name)
        _check_platform(fmpy, description, names, path.name)
        _check_step(simulation, specimen)
        known = {variable.name: variable for variable in description.modelVariables}
        units = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
        return FmuModel(
            fmi=int(description.fmiVersion[0]),
            identifier=simulation.modelIdentifier,
            token=description.guid,
            drives=_ports("drive", specimen.drives, "input", known, units),
            responses=_ports("response", specimen.responses, "output", known, units),
            start_values=tuple(
                (_find(f"start_values names {name!r}", name, ("parameter", "input"), known).valueReference, value)
                for name, value in specimen.start_values.items()
            ),
        )
    except ValueError as error:
        raise _refusal(specimen, str(error)) from error


def _refusal(specimen: FmuSpecimen, sentence: str) -> SpecimenError:
    return SpecimenError(f"specimen {specimen.name}: {sentence}")


def _fmpy(rig: str) -> ModuleType:
    try:
        return import_module("fmpy")
    except ImportError as error:
        raise SpecimenError(
            f"specimen {rig}: a rig of kind fmu needs fmpy, which is not installed; install it with: "
            "pip install 'duralab[fmu]'."
        ) from error


def _first_problem(error: Exception) -> str:
    problems = getattr(error, "problems", None) or [str(error) or type(error).__name__]
    text = " ".join(str(problems[0]).split()).rstrip(".")
    return text if len(text) <= _LONGEST_PROBLEM else f"{text[:_LONGEST_PROBLEM]} …"


def _co_simulation(description: Any, file: str) -> Any:
    if description.fmiVersion == "1.0":
        raise ValueError(f"{file} is of FMI 1.0; export it for FMI 2.0 or 3.0.")
    if description.coSimulation is None:
        raise ValueError(f"{file} is not for co-simulation; export it with its solver, for co-simulation.")
    return description.coSimulation


def _check_platform(fmpy: ModuleType, description: Any, names: Iterable[str], file: str) -> None:
    here = fmpy.platform if description.fmiVersion == "2.0" else fmpy.platform_tuple
    library = f"binaries/{here}/{description.coSimulation.modelIdentifier}{fmpy.sharedLibraryExtension}"
    if library in names:
        return
    parts = [PurePosixPath(name).parts for name in names]
    found = sorted({path[1] for path in parts if len(path) > 2 and path[0] == "binaries"})
    if here in found:
        raise ValueError(f"{file} has no {library}, where its model identifier says that its library is.")
    raise ValueError(
        f"{file} has libraries for {', '.join(found) or 'no platform'}, and this machine is {here}; "
        f"export it for {here}."
    )


def _check_step(simulation: Any, specimen: FmuSpecimen) -> None:
    fixed = float(simulation.fixedInternalStepSize or 0.0)
    step = 1.0 / (specimen.sample_rate * specimen.steps)
    if fixed > 0.0 and not (step > 0.5 * fixed and abs(step / fixed - round(step / fixed)) < 1.0e-6):
        raise ValueError(
            f"the step is {step:g} s, and the FMU's own one is {fixed:g} s; give a step that is a whole multiple of it."
        )


def _ports(
    what: str, channels: Iterable[Any], causality: str, known: Mapping[str, Any], units: Mapping[str, Any]
) -> Ports:
    references, scales = [], []
    for channel in channels:
        place = f"{what} {channel.name} is the variable {channel.variable!r}"
        variable = _find(place, channel.variable, (causality,), known)
        references.append(variable.valueReference)
        unit = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
        scales.append(_scale(place, unit, channel.unit, units))
    factor, offset = np.array(scales).T[..., None]
    return Ports(tuple(references), factor, offset)


def _find(place: str, name: str, causalities: tuple[str, ...], known: Mapping[str, Any]) -> Any:
    variable = known.get(name)
    wanted = " or ".join(causalities)
    if variable is None:
        fitting = [other.name for other in known.values() if other.causality in causalities]
        named = get_close_matches(name, fitting, n=_MOST_NAMED) or fitting[:_MOST_NAMED]
        raise ValueError(f"{place}, which the FMU has not; of the causality {wanted} are {', '.join(named) or 'none'}.")
    if variable.causality not in causalities:
        raise ValueError(f"{place}, whose causality is {variable.causality}; it must be {wanted}.")
    if variable.type not in ("Real", "Float64"):
        raise ValueError(f"{place}, whose type is {variable.type}; it must be Real (FMI 2.0) or Float64 (FMI 3.0).")
    if variable.dimensions:
        raise ValueError(f"{place}, which is an array; it must be a single value.")
    return variable


def _scale(place: str, unit: str | None, wanted: str, units: Mapping[str, Any]) -> tuple[float, float]:
    """Return factor and offset from an FMU's unit to a channel's; a variable without a unit is in the channel's."""
    base, exponents = units.get(unit or ""), _EXPONENTS.get(wanted)
    if unit is None or (base is None and _plain(unit) == wanted):
        return 1.0, 0.0
    if base is None or exponents is None or tuple(int(getattr(base, name)) for name in _BASE_UNITS) != exponents:
        raise ValueError(
            f"{place}, whose unit is {unit!r}, and the channel is in {wanted}; they must be of one quantity."
        )
    return float(base.factor), float(base.offset)


def _plain(unit: str) -> str:
    """Return a unit in this project's notation: N.m is N*m, and m/s2 is m/s^2."""
    return re.sub(r"(?<=[A-Za-z])(\d)", r"^\1", unit.replace(".", "*"))
