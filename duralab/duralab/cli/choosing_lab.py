"""Which lab a command uses where `--connect` is left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from duralab.errors import InputError

if TYPE_CHECKING:
    from duralab.cli.output import Output
    from duralab.lab import Lab


def endpoint_of_lab(given: str | None) -> str:
    """Return the endpoint that is given, or that of the one lab that `duralab up` keeps running; refuse none."""
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


@contextmanager
def open_lab(
    output: Output,
    endpoint: str | None,
    *,
    rigs: Sequence[str] = (),
    out: Path | None = None,
    viewer: str | None = None,
) -> Iterator[Lab]:
    """Join the lab at an endpoint, or start a private one with these rigs (the usual ones if none are named)."""
    from duralab.lab import DEFAULT_RIGS, connect, start
    from duralab.processes import require_shipped

    if endpoint is None:
        require_shipped(rigs, usual=DEFAULT_RIGS)
    with ExitStack() as stack:
        with output.console.status("Joining the lab …" if endpoint is not None else "Starting a private lab …"):
            lab = stack.enter_context(
                connect(endpoint, out=out)
                if endpoint is not None
                else start(out, rigs=tuple(rigs) or DEFAULT_RIGS, viewer=viewer)
            )
        yield lab
