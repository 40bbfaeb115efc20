"""`duralab down`: the end of a lab that `duralab up` keeps running."""

from __future__ import annotations

from duralab.cli.json_output import console_beside, write_json
from duralab.errors import InputError
from duralab.processes import RunningLab, end_lab, running_labs, the_running_lab


def down(*, endpoint: str | None, all_labs: bool, as_json: bool) -> None:
    """End the lab at an endpoint, the one that runs, or all; where none runs there is nothing to do."""
    console = console_beside(as_json)
    labs = _chosen(endpoint, all_labs=all_labs)
    for lab in labs:
        with console.status(f"Ending the lab at {lab.endpoint} …"):
            end_lab(lab)
        console.print(f"The lab at {lab.endpoint} is down.", highlight=False, markup=False)
    if not labs:
        console.print("No lab of yours runs on this machine.")
    if as_json:
        write_json({"ended": [{"endpoint": lab.endpoint, "process_id": lab.process_id} for lab in labs]})


def _chosen(endpoint: str | None, *, all_labs: bool) -> list[RunningLab]:
    if endpoint is not None and all_labs:
        raise InputError("--connect and --all exclude each other; give one of them.", field="connect")
    if all_labs:
        return running_labs()
    if endpoint is None:
        lab = the_running_lab()
        return [] if lab is None else [lab]
    labs = running_labs()
    if chosen := [lab for lab in labs if lab.endpoint == endpoint]:
        return chosen
    there = f"there are {', '.join(lab.endpoint for lab in labs)}" if labs else "there is none"
    raise InputError(
        f"No lab that you started on this machine with `duralab up` listens at {endpoint}; {there}.", field="connect"
    )
