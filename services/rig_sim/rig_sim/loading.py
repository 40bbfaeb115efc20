"""Loading of a rig from a YAML whose `kind` states whether it is a structure, an FMU or a multibody specimen."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

from duralab_proto.keys import LONGEST_NAME
from rig_sim import fmu, structure
from rig_sim.engines import EngineChoice
from rig_sim.playing import FIRST_SPECIMEN, Fault, Rig, load_rig
from rig_sim.specimen import SpecimenError, read_document, shipped_specimens

PlayableRig: TypeAlias = Rig | structure.StructureRig | fmu.FmuRig
"""Any rig of this simulator."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")


def rig_name(path: Path) -> str:
    """Return the name of the rig in a YAML; one made of the file's name if it states no valid name.

    Errors of the YAML are reported when the rig is loaded; until then the rig needs a name for queries. A file's name
    longer than a key allows is therefore shortened; the reported error has the whole name.
    """
    try:
        document = read_document(path)
    except SpecimenError:
        document = None
    name = document.get("name") if isinstance(document, dict) else None
    if isinstance(name, str) and len(name) <= LONGEST_NAME and _NAME.fullmatch(name):
        return name
    return ("rig_" + re.sub(r"[^a-z0-9]+", "_", path.stem.lower()).strip("_"))[:LONGEST_NAME]


def shipped_titles() -> dict[str, str]:
    """Return the titles of the shipped rigs by name, without loading them."""
    return {name: read_document(path)["title"] for name, path in shipped_specimens().items()}


def shipped_documents() -> dict[str, dict[str, object]]:
    """Return path (`path`) and content (`document`) of the YAML of each shipped rig, by name."""
    return {name: {"path": str(path), "document": read_document(path)} for name, path in shipped_specimens().items()}


def rigs_by_name(paths: Iterable[Path]) -> dict[str, Path]:
    """Return the YAMLs of some rigs by the rigs' names, in order."""
    named: dict[str, Path] = {}
    for path in paths:
        if not path.is_file():
            raise SpecimenError(f"specimen {path.name} cannot be read: there is no such file.")
        name = rig_name(path)
        if name in named:
            raise SpecimenError(f"two rigs are called {name!r}; names must differ.")
        named[name] = path
    return named


def load_any_rig(
    path: Path,
    engines: Mapping[str, EngineChoice] | None = None,
    faults: Mapping[str, Sequence[Fault]] | None = None,
    mounted: Mapping[str, str] | None = None,
    *,
    prove_later: bool = False,
) -> PlayableRig:
    """Load a rig of any kind from its YAML.

    Parameters
    ----------
    path : Path
        The YAML; the files that it names are in its folder.
    engines : mapping, optional
        Engine by the rig's name. A structure and an FMU take none.
    faults : mapping, optional
        Faults to inject, by the rig's name. A structure and an FMU take those of sensors.
    mounted : mapping, optional
        Name of the mounted specimen, by the rig's name. Only for a rig that wears.
    prove_later : bool
        As for `load_rig`.

    Returns
    -------
    PlayableRig
        Rig of the kind stated in the YAML.

    Raises
    ------
    SpecimenError, NoEquilibriumError, ProofError
        The specimen cannot be used; one sentence each.
    """
    document = read_document(path)
    kind = document.get("kind") if isinstance(document, dict) else None
    name = rig_name(path)
    injected = (faults or {}).get(name, ())
    if kind is None:
        rig = load_rig(
            path,
            (engines or {}).get(name, EngineChoice()),
            faults=injected,
            mounted=(mounted or {}).get(name, FIRST_SPECIMEN),
            prove_later=prove_later,
        )
        if name in (mounted or {}) and not rig.wears:
            raise _does_not_wear(path, name)
        return rig
    if kind not in (structure.KIND, fmu.KIND):
        raise SpecimenError(
            f"specimen {path.name}: kind is {kind!r}; leave it out for a multibody rig, or say {structure.KIND} or "
            f"{fmu.KIND}."
        )
    if name in (mounted or {}):
        raise _does_not_wear(path, name)
    if name in (engines or {}):
        player = "in closed form" if kind == structure.KIND else "by its FMU"
        raise SpecimenError(
            f"specimen {path.name}: {name} is played {player} and takes no engine; leave it out of engines."
        )
    return structure.load_structure(path, injected) if kind == structure.KIND else fmu.load_fmu_rig(path, injected)


def _does_not_wear(path: Path, name: str) -> SpecimenError:
    return SpecimenError(
        f"specimen {path.name}: {name} does not wear, so all its specimens are one; leave it out of mounted."
    )
