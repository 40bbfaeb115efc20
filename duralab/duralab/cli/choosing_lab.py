"""Which lab a command uses where `--connect` is left out."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.lab import Lab


def endpoint_of_lab(given: str | None) -> str:
    """Return the endpoint that is given, or that of the one lab that `duralab up` keeps running.

    Raises
    ------
    InputError
        None runs here, or several do.
    """
    if (endpoint := endpoint_if_any(given)) is None:
        raise InputError(
            "No lab of yours runs on this machine; start one with `duralab up`, or name one with --connect ENDPOINT.",
            field="connect",
        )
    return endpoint


def endpoint_if_any(given: str | None) -> str | None:
    """Return the endpoint that is given, or that of the one lab that runs; None where none does."""
    if given is not None:
        return given
    from duralab.processes import the_running_lab

    lab = the_running_lab()
    return None if lab is None else lab.endpoint


def open_lab(endpoint: str | None, *, rigs: Sequence[str] = ()) -> AbstractContextManager[Lab]:
    """Return the lab at an endpoint, or one of one's own with these rigs, or the usual ones, where none is given."""
    from duralab.lab import DEFAULT_RIGS, connect, start
    from duralab.processes import require_shipped

    if endpoint is not None:
        return connect(endpoint)
    require_shipped(rigs, usual=DEFAULT_RIGS)
    return start(rigs=tuple(rigs) or DEFAULT_RIGS)
