"""The demo campaign as it was identified before: by one loud experiment, whose first drives are worse."""

from __future__ import annotations

from typing import Any

LEVELS = {"vertical": 0.0025, "lateral": 4e-5, "longitudinal": 1.5e-4}


def identified_by_one_experiment(document: dict[str, Any]) -> None:
    """Change a campaign on the stiff front axle."""
    excitation = document["excitation"]
    del excitation["at_target"]
    excitation["rms"] = {f"{side}_{axis}": rms for side in ("left", "right") for axis, rms in LEVELS.items()}
    excitation["duration"] = 75.0
