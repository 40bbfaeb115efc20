"""From a YAML to a rig that plays: its `kind` says whether it is a structure in state space or a multibody specimen."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from duralab_proto.keys import LONGEST_NAME
from rig_sim.engines import EngineChoice
from rig_sim.playing import Fault, load_rig
from rig_sim.specimen import SpecimenError, read_document, shipped_specimens
from rig_sim.structure import KIND, PlayableRig, load_structure

_NAME = re.compile(r"[a-z][a-z0-9_]*")


def rig_name(path: Path) -> str:
    """Return the name of the rig in a YAML; one made of the file's name where it says none that can be one.

    What is wrong with the YAML is said when the rig is loaded: until then, somebody has to be asked for it by name. So
    a file's name is cut where it is longer than a key may hold; the reason tells all of it.
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
    """Return what is mounted on each shipped rig, in words, by its name; nothing is loaded for it."""
    return {name: read_document(path)["title"] for name, path in shipped_specimens().items()}


def shipped_documents() -> dict[str, dict[str, object]]:
    """Return where the YAML of each shipped rig is (`path`) and what it says (`document`), by name."""
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
) -> PlayableRig:
    """Load a rig of any kind from its YAML.

    Parameters
    ----------
    path : Path
        The YAML; what it names lies beside it.
    engines : mapping, optional
        By the rig's name: what integrates it. A structure has nothing to integrate and takes none.
    faults : mapping, optional
        By the rig's name: faults to inject. A structure takes those of sensors.

    Returns
    -------
    PlayableRig
        Of the kind that the YAML says.

    Raises
    ------
    SpecimenError, NoEquilibriumError, ProofError
        Where the specimen cannot be used; one sentence each.
    """
    document = read_document(path)
    kind = document.get("kind") if isinstance(document, dict) else None
    name = rig_name(path)
    injected = (faults or {}).get(name, ())
    if kind is None:
        return load_rig(path, (engines or {}).get(name, EngineChoice()), faults=injected)
    if kind != KIND:
        raise SpecimenError(f"specimen {path.name}: kind is {kind!r}; leave it out for a multibody rig, or say {KIND}.")
    if name in (engines or {}):
        raise SpecimenError(
            f"specimen {path.name}: {name} is played in closed form and takes no engine; leave it out of engines."
        )
    return load_structure(path, injected)
