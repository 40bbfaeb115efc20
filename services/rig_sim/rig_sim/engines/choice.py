"""Engine of a rig: the compiled player or Drake, behind one interface."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

from pydantic import BaseModel, Field, model_validator

from rig_sim.parameters import STRICT, Positive


class Engine(StrEnum):
    """A program that integrates a rig."""

    #: Generated code, the integrator and substeps of the specimen; some hundred times faster than real time.
    COMPILED = "compiled"
    #: Drake's plant and integrator, Runge-Kutta 3; slower than real time, the reference for the compiled player.
    DRAKE = "drake"


class EngineChoice(BaseModel):
    """An engine and, for Drake, its steps: by error control to an accuracy, or with a fixed step if one is given.

    In a configuration the name of the engine alone is enough.
    """

    model_config = STRICT

    engine: Engine = Engine.COMPILED
    #: Drake's target accuracy: about the largest error of a step, in m, m/s, MPa or shares of one.
    accuracy: Annotated[float, Field(ge=1.0e-10, le=1.0e-2)] | None = None
    #: Fixed step in s, one sample at most.
    fixed_step: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_its_name(cls, value: Any) -> Any:
        return {"engine": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _steps_one_way(self) -> EngineChoice:
        given = [name for name in ("accuracy", "fixed_step") if getattr(self, name) is not None]
        if self.engine is Engine.COMPILED and given:
            raise ValueError(
                f"{given[0]} is for the engine drake; the compiled engine takes the substeps of the specimen"
            )
        if len(given) > 1:
            raise ValueError("accuracy and fixed_step are both given; take one of them")
        return self
