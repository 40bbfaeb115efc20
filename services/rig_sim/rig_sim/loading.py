"""From a YAML to a rig that plays: its `kind` says whether it is a structure in state space or a multibody specimen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rig_sim.engine import EngineChoice
from rig_sim.faults import Fault
from rig_sim.playable import PlayableRig
from rig_sim.player import load_rig
from rig_sim.specimen import SpecimenError, load_specimen, read_document
from rig_sim.structure.rig import load_structure
from rig_sim.structure.specimen import KIND


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
        By the rig's name: faults to inject. A structure takes none.

    Raises
    ------
    SpecimenError, NoEquilibriumError, ProofError
        Where the specimen cannot be used; one sentence each.
    """
    document = read_document(path)
    kind = document.get("kind") if isinstance(document, dict) else None
    if kind is None:
        name = load_specimen(path).name
        return load_rig(path, (engines or {}).get(name, EngineChoice()), faults=(faults or {}).get(name, ()))
    if kind != KIND:
        raise SpecimenError(f"specimen {path.name}: kind is {kind!r}; leave it out for a multibody rig, or say {KIND}.")
    rig = load_structure(path)
    if rig.specimen.name in (engines or {}):
        raise SpecimenError(
            f"specimen {path.name}: {rig.specimen.name} is played in closed form and takes no engine; leave it out "
            "of engines."
        )
    if rig.specimen.name in (faults or {}):
        raise SpecimenError(
            f"specimen {path.name}: {rig.specimen.name} is a structure, which knows no faults; leave it out of faults."
        )
    return rig
