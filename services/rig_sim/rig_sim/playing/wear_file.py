"""State of a worn specimen on disk: one file for each specimen, whole or not written at all."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import ValidationError

from duralab_settings import explain_validation, read_regular
from rig_sim.playing.wear import WearState
from rig_sim.specimen import SpecimenError


class WearFile:
    """File of the state of one specimen; it is only replaced as a whole, so a killed rig finds the last state."""

    def __init__(self, folder: Path, *, rig: str, specimen: str) -> None:
        self.path = folder / f"{rig}.{specimen}.json"

    def read(self, parts: set[str]) -> WearState:
        """Return the last state, or a new specimen's if there is no file; raises `SpecimenError` if it is invalid."""
        try:
            state = WearState.model_validate_json(read_regular(self.path, largest=_LARGEST))
        except FileNotFoundError:
            return WearState()
        except OSError as error:
            raise SpecimenError(f"wear state {self.path.name} cannot be read: {error.strerror}.") from error
        except ValidationError as error:
            said = explain_validation(error, WearState).sentence
            raise SpecimenError(f"wear state {self.path.name} is damaged: {said} {_REMEDY}") from error
        if state.damage and set(state.damage) != parts:
            raise SpecimenError(
                f"wear state {self.path.name} is of {', '.join(sorted(state.damage))}, but what wears is "
                f"{', '.join(sorted(parts)) or 'nothing'}. {_REMEDY}"
            )
        return state

    def write(self, state: WearState) -> None:
        """Replace the state; raises `OSError` if the disk refuses it."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        partial = self.path.with_suffix(".part")
        with partial.open("w", encoding="utf-8") as stream:
            stream.write(state.model_dump_json(indent=2) + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(self.path)


_LARGEST = 2**20
_REMEDY = "Mount another specimen (`mounted` of the configuration), or bring back the file of this one."
