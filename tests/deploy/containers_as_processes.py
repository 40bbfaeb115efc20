"""The compose file's containers as plain processes: its commands, users, read-only roots, volumes, in one network."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from .compose_file import ROOT, Container, containers, image_environment, stages

_SCRIPT = Path(__file__).with_name("container_like.sh")
_ROUTER = ROOT / "tests" / "security" / "router_process.py"
_END_SECONDS = 10.0
_SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/etc/ld.so.cache", "/etc/ssl")


def why_not() -> str:
    """Return why this machine cannot do it; empty where it can."""
    if os.geteuid() != 0:
        return "only root may make namespaces and become another user"
    missing = [tool for tool in ("ip", "unshare", "chroot", "setpriv", "mount") if shutil.which(tool) is None]
    if missing:
        return f"there is no {', '.join(missing)}"
    tried = subprocess.run(
        ["unshare", "--mount", "--net", "mount", "-t", "tmpfs", "tmpfs", "/mnt"], capture_output=True, check=False
    )
    return "" if tried.returncode == 0 else f"no namespaces here: {tried.stderr.decode().strip()}"


class ContainersAsProcesses:
    """Starts containers of the compose file as processes; use it in a `with` statement.

    Parameters
    ----------
    folder : Path
        For volumes, logs and roots.
    certificates : Path
        Of the lab; the user of the containers may read the keys.
    network : str
        Name of the network namespace they share; unique on this machine.
    """

    def __init__(self, folder: Path, *, certificates: Path, network: str) -> None:
        self._folder = folder
        self._network = network
        self.containers = containers({"DURALAB_CERTIFICATES": str(certificates), "DURALAB_PAGE": str(certificates)})
        self._stages = stages()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self.hosts = folder / "hosts"
        self.hosts.write_text(f"127.0.0.1 localhost {' '.join(self.containers)}\n")

    def __enter__(self) -> ContainersAsProcesses:
        subprocess.run(["ip", "netns", "add", self._network], check=True)
        subprocess.run(["ip", "-n", self._network, "link", "set", "lo", "up"], check=True)
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            if process.poll() is None:
                process.kill()
            process.wait()
            if process.stdin is not None:
                process.stdin.close()
        left = subprocess.run(["ip", "netns", "pids", self._network], capture_output=True, text=True, check=True).stdout
        subprocess.run(["ip", "netns", "delete", self._network], check=True)
        assert not left.split(), f"The processes {left.split()} outlived their containers."

    def start(self, name: str) -> None:
        """Start a container's command."""
        with self.log(name).open("wb") as log:
            self._processes[name] = subprocess.Popen(
                self._command(self.containers[name], self.containers[name].command),
                # Open for as long as this process lives: the router within Python ends with it.
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
            )

    def log(self, name: str) -> Path:
        """Return where its log is."""
        return self._folder / f"{name}.log"

    def volume(self, name: str) -> Path:
        """Return the folder of a volume."""
        return self._folder / "volumes" / name

    def run(self, name: str, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
        """Run another command in a place like a container's."""
        return subprocess.run(
            self._command(self.containers[name], command), capture_output=True, text=True, check=False
        )

    def run_beside(self, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
        """Run a command of this machine in the network of the containers."""
        return subprocess.run(
            ["ip", "netns", "exec", self._network, *command], capture_output=True, text=True, check=False
        )

    def wait_until_healthy(self, name: str, *, timeout_seconds: float) -> None:
        """Run the health check until it passes; AssertionError with its last words where it does not in time."""
        deadline = time.monotonic() + timeout_seconds
        while (checked := self.run(name, self.containers[name].health)).returncode != 0:
            code = self._processes[name].poll()
            last = self.log(name).read_text(errors="replace")[-2000:]
            assert code is None, f"{name} ended with {code}: {last}"
            assert time.monotonic() < deadline, f"{name} is sick: {checked.stderr} {last}"

    def stop(self, name: str) -> int:
        """Tell a container to end as the engine does, and return its exit code."""
        self._processes[name].terminate()
        return self._processes[name].wait(_END_SECONDS)

    def process_id(self, name: str) -> int:
        return self._processes[name].pid

    def _command(self, container: Container, command: Sequence[str]) -> list[str]:
        place = self._folder / "roots" / container.name
        place.mkdir(parents=True, exist_ok=True)
        plan = self._folder / f"{container.name}.plan"
        plan.write_text("".join(f"{kind} {source} {target}\n" for kind, source, target in self._plan(container)))
        environment = self._environment(container)
        return [
            *("ip", "netns", "exec", self._network, "unshare", "--mount", "--propagation", "private"),
            *("env", f"CONTAINER_USER={container.user}", f"CONTAINER_GROUP={container.group}"),
            *(str(_SCRIPT), str(place), str(plan)),
            *(f"{key}={value}" for key, value in environment.items()),
            *self._program(container, command),
        ]

    def _program(self, container: Container, command: Sequence[str]) -> list[str]:
        if command[0] == "/zenohd" and not Path("/zenohd").exists():
            # The same configuration in the same router, within Python.
            assert command[1] == "--config"
            return ["python", str(_ROUTER), command[2], json.dumps({})]
        return list(command)

    def _environment(self, container: Container) -> dict[str, str]:
        image = {"rig": "rig_sim", "file-rig": "file_rig", "page": "operator_page"}.get(container.name, container.name)
        own = image_environment(self._stages[image if image in self._stages else "run"], self._stages)
        # What stands in the image at /opt/duralab stands here in the environment that runs the tests.
        programs = Path(sys.prefix) / "bin"
        viewer = next(Path(sys.prefix).glob("lib/python*/site-packages/rerun_cli"))
        # As in its image, the viewer is the program, not the script around it: that leaves it behind when killed.
        own["PATH"] = f"{viewer}:{programs}:/usr/local/bin:/usr/bin:/bin"
        if "XDG_CONFIG_HOME" in own:
            own["XDG_CONFIG_HOME"] = str(self._folder)
        own |= container.environment
        if "DURALAB__METRICS__PORT" in own:
            # Containers have a network each and the same port; here they share one.
            own["DURALAB__METRICS__PORT"] = "0"
        return own

    def _plan(self, container: Container) -> list[tuple[str, str, str]]:
        plan = [("ro", path, path) for path in _SYSTEM if Path(path).exists()]
        plan += [("rw", "/dev", "/dev"), ("rw", "/proc", "/proc"), ("ro", str(self.hosts), "/etc/hosts")]
        plan += [("tmpfs", options, target) for target, options in container.tmpfs.items()]
        # After the empty /tmp: a clone may lie in it.
        plan += [("ro", path, path) for path in (str(ROOT), sys.prefix, sys.base_prefix)]
        for mount in container.mounts:
            source = mount.source if mount.read_only else str(self._made_volume(mount.source, container))
            plan.append(("ro" if mount.read_only else "rw", source, mount.target))
        return plan

    def _made_volume(self, name: str, container: Container) -> Path:
        folder = self.volume(name)
        folder.mkdir(parents=True, exist_ok=True)
        # As the engine does: a new volume belongs to whom the image's folder belongs.
        os.chown(folder, container.user, container.group)
        return folder
