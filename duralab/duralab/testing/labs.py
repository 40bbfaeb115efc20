"""Labs for tests: the services of a lab on a free port, with custom rigs in this process or another one."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from duralab.conformance import Finding, check_rig
from duralab.errors import InputError, LabError
from duralab.lab import Lab, RecordingsPlace
from duralab.processes import Supervisor, lab_services
from duralab_bus import Bus, BusConfig, FaultError, open_bus
from duralab_drive_files import read_controller_map
from duralab_gateway import SERVICE, Approach, GatewayConfig, Rig, serving
from duralab_settings import dump_yaml

FOREIGN_RIG = "stranger"
"""Name of the rig of the foreign gateway."""

_WAIT_SECONDS = 60.0


@contextmanager
def lab(
    *rigs: Rig,
    out: Path,
    simulated: Sequence[str] = (),
    endurance: bool = False,
    approach: Approach = Approach(ramp=0.0),  # noqa: B008 - frozen
) -> Iterator[Lab]:
    """Start a lab until the block ends; this process serves its custom rigs.

    Parameters
    ----------
    *rigs : Rig
        Custom rigs, with the names in their descriptions.
    out : Path
        Folder for results, recordings and logs.
    simulated : sequence of str
        Shipped rigs for the simulator, which is not started if there are none.
    endurance : bool
        Whether to start a sequencer as well, for `Lab.endure`.
    approach : Approach
        Ramps of the rigs to a drive's first sample and back; if not given, a run begins with a step.

    Yields
    ------
    Lab
        Lab on a free port of 127.0.0.1; its processes end with the block, also after an exception.

    Raises
    ------
    InputError
        No rig is given.
    ConfigError
        A description cannot be served.
    LabError
        A service did not start.
    """
    if not rigs and not simulated:
        raise InputError("the lab has no rig; give it one or more, such as LinearRig().", field="rigs")
    with ExitStack() as stack:
        bus = stack.enter_context(open_bus(BusConfig(), service="duralab"))
        recordings = out / "recordings"
        plans = lab_services(rigs=simulated, recordings=recordings, viewer=None, endurance=endurance)
        wanted = tuple(plan for plan in plans if simulated or plan.name != SERVICE)
        supervisor = stack.enter_context(Supervisor(wanted, bus=bus, logs=out / "logs"))
        supervisor.start()
        if rigs:
            joined = stack.enter_context(open_bus(BusConfig(connect=bus.listening), service=SERVICE))
            servers = stack.enter_context(serving(joined, *rigs, config=GatewayConfig(), approach=approach))
            # Stop serving before the rigs are closed: a handler may be using one.
            stack.callback(joined.stop_serving)
            bus.wait_for_live({(SERVICE, server.name) for server in servers}, _WAIT_SECONDS)
        yield Lab(bus, out=out, supervisor=supervisor, recordings=RecordingsPlace(recordings))


def check_contract(
    rig: Rig,
    *,
    seconds: float = 1.0,
    approach: Approach = Approach(ramp=0.0),  # noqa: B008 - frozen
) -> list[Finding]:
    """Check whether a rig conforms to the contract, as `duralab check-rig` does, on a separate bus.

    Parameters
    ----------
    rig : Rig
        Rig to check; it moves by 1 % of its limits, and is stopped once.
    seconds : float
        Length of each of the two played drives, in s.
    approach : Approach
        Ramps of the rig to a drive's first sample and back.

    Returns
    -------
    list of Finding
        Findings in the order of the checks; see `duralab.conformance.all_passed`.

    Raises
    ------
    ConfigError
        The description cannot be served.
    """
    with (
        open_bus(BusConfig(), service=SERVICE) as served,
        serving(served, rig, approach=approach) as (server,),
        open_bus(BusConfig(connect=served.listening), service="duralab") as bus,
    ):
        bus.wait_for_live({(SERVICE, server.name)}, _WAIT_SECONDS)
        return check_rig(bus, server.name, seconds=seconds)


@contextmanager
def foreign_gateway(endpoint: str) -> Iterator[int]:
    """Run a gateway that uses Zenoh and the messages, but no other code of this project, until the block ends.

    Its rig `stranger` has two cylinders on a beam, is slightly nonlinear, and plays without delay.

    Parameters
    ----------
    endpoint : str
        Endpoint of the lab to join, from `Lab.endpoints`.

    Yields
    ------
    int
        Process id of the gateway.

    Raises
    ------
    LabError
        It did not join.
    """
    command = [sys.executable, str(Path(__file__).with_name("foreign_gateway.py")), endpoint]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            said = process.stdout.readline() if process.stdout is not None else ""
            if said != f"ready {FOREIGN_RIG}\n":
                raise LabError(f"The foreign gateway did not join the lab at {endpoint}; is a lab there?")
            yield process.pid
        finally:
            process.kill()


@contextmanager
def file_gateway(controller_map: Path, endpoint: str, *, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run `file_rig`, the gateway to a controller that exchanges files, as a process until the block ends.

    Parameters
    ----------
    controller_map : Path
        YAML file of the map of the served rig.
    endpoint : str
        Endpoint of the lab to join, from `Lab.endpoints`.
    folder : Path
        Folder for its configuration, spool and log, `file_rig.log`.

    Yields
    ------
    subprocess.Popen
        Process whose rig is on the bus.

    Raises
    ------
    DriveFileError
        The map is not allowed.
    LabError
        It did not join.
    """
    rig = read_controller_map(controller_map).rig
    folder.mkdir(parents=True, exist_ok=True)
    config = folder / "file_rig.yaml"
    settings = {"maps": [str(controller_map.resolve())], "spool_folder": str((folder / "spool").resolve())}
    config.write_text(dump_yaml({"bus": {"connect": [endpoint]}, "exit_with_parent": True, **settings}))
    with ExitStack() as stack:
        log = stack.enter_context((folder / "file_rig.log").open("ab"))
        command = [sys.executable, "-m", "file_rig", "--config", str(config)]
        process = stack.enter_context(
            subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log, start_new_session=True)
        )
        stack.callback(process.kill)
        with open_bus(BusConfig(connect=(endpoint,)), service="duralab") as bus:
            _wait_for_gateway(bus, process, rig, folder / "file_rig.log")
        yield process
        process.terminate()
        process.wait(_WAIT_SECONDS)


def _wait_for_gateway(bus: Bus, process: subprocess.Popen[bytes], rig: str, log: Path) -> None:
    end = time.monotonic() + _WAIT_SECONDS
    while True:
        try:
            return bus.wait_for_live({(SERVICE, rig)}, 0.5)
        except FaultError as fault:
            if process.poll() is None and time.monotonic() < end:
                continue
            said = log.read_text(encoding="utf-8").strip().splitlines()[-1:]
            raise LabError(f"file_rig did not join the lab: {said[0] if said else 'it says nothing'}") from fault
