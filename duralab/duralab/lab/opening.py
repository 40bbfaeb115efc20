"""Opening a lab: start a private lab on this machine, or join a running one."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import ValidationError

from duralab.arguments import require_path, require_switch, require_text
from duralab.errors import InputError, UnavailableError
from duralab.lab.client import require_time
from duralab.lab.recordings_folder import RecordingsPlace, own_recordings
from duralab.processes import Supervisor, lab_services, the_running_lab
from duralab_bus import Bus, BusConfig, BusError, BusMode, FaultError, TlsConfig, open_bus

if TYPE_CHECKING:
    from duralab.lab.lab import Lab

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7474"
"""Default endpoint on which `duralab up` listens, and to which `connect` connects."""

SECURED: Final = "tls/"
IDENTITY_VARIABLE: Final = "DURALAB_IDENTITY"
"""Environment variable with the path of the certificate for a secured lab, if no `identity` is given."""

FREE_ENDPOINT: Final = "tcp/127.0.0.1:0"
DEFAULT_RIGS: Final = ("front_axle", "predecessor")

QUIET_SECONDS: Final = 0.4
_POLL_SECONDS: Final = 0.05

FIND_SECONDS: Final = 5.0
"""Longest time to find the services; a new session usually finds all in about one second."""


@contextmanager
def start(
    out: str | Path | None = None,
    *,
    listen: str = FREE_ENDPOINT,
    recordings: str | Path | None = None,
    rigs: Sequence[str] = DEFAULT_RIGS,
    viewer: str | None = None,
    real_time: bool = False,
    endurance: bool = False,
    trace_folder: str | Path | None = None,
    needs_later: Sequence[str | Callable[[], None]] = (),
) -> Iterator[Lab]:
    """Start a private lab on this machine: four service processes, which end with the `with` statement.

    Parameters
    ----------
    out : str or Path, optional
        Folder for results and for `logs/<service>.log`; a temporary one, removed at the end, if not given.
        While the lab is open, its folder `recordings` is the recorder's. It is removed at the end, unless it
        contains the recording of a campaign that failed or was not fetched: then it is reported and kept.
    listen : str
        Endpoint for other processes; a free port of 127.0.0.1 if not given.
    recordings : str or Path, optional
        Recorder's folder, which is kept; the one in `out` if not given.
    rigs : sequence of str
        Names of the rigs to start.
    viewer : str, optional
        Address of a running Rerun viewer.
    real_time : bool
        Whether to play every drive in real time, regardless of the request: a rehearsal of a real rig. The responses
        are the same.
    endurance : bool
        Whether to start a sequencer as well, for `Lab.endure`.
    trace_folder : str or Path, optional
        Existing folder for the time traces of the services, for `duralab.profile.Profile`.
    needs_later : sequence of str or callable
        Modules that the caller needs next, imported while the services start, and functions called between.

    Yields
    ------
    Lab
        Open until the `with` statement ends.

    Raises
    ------
    InputError
        An argument has the wrong type, no rig is given, the port is in use, or a folder cannot be made.
    LabError
        A service did not start.
    """
    require_text(listen, field="listen")
    if viewer is not None:
        require_text(viewer, field="viewer")
    require_path(out, of="a folder", field="out")
    require_path(recordings, of="a folder", field="recordings")
    # A string is also a sequence of strings: its letters.
    if isinstance(rigs, str) or not isinstance(rigs, Sequence) or not rigs:
        raise InputError(f"rigs is {rigs!r}; give the names of one rig or more, such as ('front_axle',).", field="rigs")
    for rig in rigs:
        require_text(rig, field="rigs")
    require_switch(real_time, field="real_time")
    require_switch(endurance, field="endurance")
    require_path(trace_folder, of="a folder", field="trace_folder")
    if trace_folder is not None and not Path(trace_folder).is_dir():
        raise InputError(
            f"trace_folder is {str(trace_folder)!r}, which is not an existing folder; make it.", field="trace_folder"
        )
    with ExitStack() as stack:
        bus = stack.enter_context(_open(listen=(listen,), connect=()))
        if recordings is None:
            place = stack.enter_context(own_recordings(Path(out) if out is not None else None))
        else:
            place = RecordingsPlace(Path(recordings), passing=_passing(stack, out))
        folder = place.passing or Path(out or "")
        plans = lab_services(
            rigs=rigs,
            recordings=place.folder or folder,
            viewer=viewer,
            real_time=bool(real_time),
            endurance=bool(endurance),
            new_lab=listen == FREE_ENDPOINT,
        )
        traces = Path(trace_folder) if trace_folder is not None else None
        supervisor = stack.enter_context(Supervisor(plans, bus=bus, logs=folder / "logs", trace_folder=traces))
        supervisor.start(needs_later=("duralab.lab.lab", *needs_later))
        from duralab.lab.lab import Lab

        yield Lab(bus, out=folder, supervisor=supervisor, recordings=place)


@contextmanager
def connect(
    endpoint: str | None = None,
    *,
    out: str | Path | None = None,
    timeout_seconds: float = FIND_SECONDS,
    identity: str | Path | None = None,
) -> Iterator[Lab]:
    """Join a running lab, e.g. one of `duralab up`.

    Parameters
    ----------
    endpoint : str, optional
        Endpoint of the lab; if not given, the one lab of `duralab up` that runs on this machine, or without such a lab
        `tcp/127.0.0.1:7474`.
    out : str or Path, optional
        Folder for results; a temporary one, removed at the end, if not given.
    timeout_seconds : float
        Longest time to find the services of the lab.
    identity : str or Path, optional
        For an endpoint `tls/…` of a secured lab: path of your certificate without its suffix,
        `<folder>/<role>.<name>`, with `.crt`, `.key` and the lab's `ca.crt` in the folder; the value of
        DURALAB_IDENTITY if not given.

    Yields
    ------
    Lab
        Open until the `with` statement ends; the services continue.

    Raises
    ------
    InputError
        An argument has the wrong type, no lab listens there, several labs run here and none is named, or the lab
        refuses this identity.
    UnavailableError
        A service of the lab is not on the bus.
    """
    if endpoint is not None:
        require_text(endpoint, field="endpoint")
    require_path(out, of="a folder", field="out")
    require_path(identity, of="a certificate", field="identity")
    require_time(timeout_seconds, field="timeout_seconds")
    if endpoint is None:
        running = the_running_lab()
        endpoint = running.endpoint if running is not None else DEFAULT_ENDPOINT
    with ExitStack() as stack:
        bus = stack.enter_context(join_bus(endpoint, identity=identity))
        needed = {(service, "main") for service in ("identifier", "iterator", "recorder")}
        try:
            bus.wait_for_live(needed, timeout_seconds)
        except FaultError as fault:
            raise UnavailableError(f"The lab at {endpoint} is not complete: {fault.message}") from fault
        _wait_until_all_are_known(bus)
        place = RecordingsPlace(passing=_passing(stack, out), goes_on=True)
        from duralab.lab.lab import Lab

        yield Lab(bus, out=place.passing or Path(out or ""), recordings=place)


def join_bus(endpoint: str, *, identity: str | Path | None = None) -> Bus:
    """Open a session that joins the bus at an endpoint; `tls/…` needs an `identity`, as for `connect`."""
    if not endpoint.startswith(SECURED):
        return _open(listen=(FREE_ENDPOINT,), connect=(endpoint,))
    shown = identity or os.environ.get(IDENTITY_VARIABLE)
    if not shown:
        raise InputError(
            f"The lab at {endpoint} is secured; say who you are with {IDENTITY_VARIABLE}=<folder>/<role>.<name>, "
            "the path of your certificate without '.crt'."
        )
    # All traffic goes through the router, which enforces the access rights.
    return _open(mode=BusMode.CLIENT, connect=(endpoint,), tls=TlsConfig.of(shown))


def _passing(stack: ExitStack, out: str | Path | None) -> Path | None:
    """Return a folder for results that is deleted with `stack`; None if the user gave a folder."""
    if out is not None:
        return None
    return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="duralab-", ignore_cleanup_errors=True))) / "out"


def _wait_until_all_are_known(bus: Bus) -> None:
    """Wait until no new service appears for `QUIET_SECONDS`: the number of a lab's rigs is not known beforehand."""
    known, quiet_since = bus.live(), time.monotonic()
    deadline = quiet_since + FIND_SECONDS
    while time.monotonic() < min(deadline, quiet_since + QUIET_SECONDS):
        time.sleep(_POLL_SECONDS)
        if (now := bus.live()) != known:
            known, quiet_since = now, time.monotonic()


def _open(**settings: object) -> Bus:
    try:
        return open_bus(BusConfig.model_validate(settings), service="duralab")
    except ValidationError as error:
        reason = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise InputError(f"{reason[0].upper()}{reason[1:]}.") from error
    except BusError as error:
        raise InputError(str(error)) from error
