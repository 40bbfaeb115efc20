"""Process that starts services by forking itself, so that common imports are made once.

`python -m duralab.processes.fork_server SOCKET`: reads requests from an inherited packet socket, answers each with a
process id or an error number, and reports the exit code of each service when it ends. It ends with the socket. A fork
is safe here because this process has one thread: a service's imports at its start do not start threads.
"""

from __future__ import annotations

import errno
import gc
import importlib
import json
import os
import runpy
import selectors
import signal
import socket
import sys
import traceback
from contextlib import suppress
from importlib.util import find_spec
from typing import Any, Final, NoReturn

LARGEST_PACKET: Final = 65_536

COLLECT_AFTER: Final = 10_000
"""New objects from which Python looks for garbage: with its 700 a start did so 400 times, and found next to none."""

_SHARED: Final = ("duralab_bus", "duralab_settings", "duralab_gateway")
"""Modules that most services import at their start."""

_SIMULATOR: Final = "rig_sim"
_AHEAD: Final = (_SIMULATOR, "recorder", "identifier", "iterator")
"""Services of every lab, whose imports are made until the first request arrives; the slowest first."""

_MATHEMATICS: Final = ("duralab_loads", "duralab_spectra", "duralab_drive_map", "scipy.ndimage", "scipy.special")
"""Modules of the services that do mathematics: imported while the simulator, which needs none, loads its rigs."""

if sys.platform != "win32":  # which has no fork
    from setproctitle import setproctitle, setthreadtitle

    def main() -> None:
        """Serve requests until the other end of the socket is closed."""
        channel = socket.socket(fileno=int(sys.argv[1]))
        channel.setblocking(False)
        # What is imported is never garbage. Each service collects its own, without the imported objects, whose memory
        # pages a collection would copy.
        gc.disable()
        gc.set_threshold(COLLECT_AFTER)
        import_shared()
        children_end, on_child = socket.socketpair()
        for end in (children_end, on_child):
            end.setblocking(False)
        signal.set_wakeup_fd(on_child.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
        started: set[str] = set()
        ahead = [*_AHEAD]
        with selectors.DefaultSelector() as selector:
            selector.register(channel, selectors.EVENT_READ)
            selector.register(children_end, selectors.EVENT_READ)
            while True:
                ready = {key.fileobj for key, _ in selector.select(0.0 if ahead else None)}
                if ahead and not ready:
                    _import_service(ahead.pop(0))
                    continue
                # After the first request, leave the processor to the services.
                ahead.clear()
                if channel in ready and not _answer(channel, started, inherited=(channel, children_end, on_child)):
                    return
                if children_end in ready:
                    children_end.recv(LARGEST_PACKET)
                    _tell_ended(channel)

    def _answer(channel: socket.socket, started: set[str], *, inherited: tuple[socket.socket, ...]) -> bool:
        """Start one service; return False if the socket was closed."""
        packet, ends, _, _ = socket.recv_fds(channel, LARGEST_PACKET, 1)
        if not packet:
            return False
        request, (life_line,) = json.loads(packet), ends
        name = request["name"]
        # The first simulator makes its imports itself, beside those of the other services, which are made here once.
        if name != _SIMULATOR or name in started:
            _import_service(name)
        started.add(name)
        gc.freeze()
        try:
            pid = os.fork()
        except OSError as error:
            os.close(life_line)
            _send(channel, {"error": error.errno or errno.EAGAIN})
            return True
        if pid == 0:
            _become_service(request, life_line, inherited)
        os.close(life_line)
        _send(channel, {"pid": pid})
        return True

    def import_shared() -> None:
        """Make the imports that most services share."""
        # structlog would import rich for lines in colour, which no service writes, and pydantic would read the metadata
        # of all installed packages in search of plug-ins: a quarter of these imports.
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        sys.modules.setdefault("rich", None)  # type: ignore[arg-type]  (an import of it fails)
        importlib.import_module("structlog")
        if sys.modules["rich"] is None:
            del sys.modules["rich"]
        for name in _SHARED:
            importlib.import_module(name)

    def _import_service(name: str) -> None:
        """Import a service if it is installed, so that later forks have it imported."""
        if name != _SIMULATOR:
            from duralab_bus import import_base_of_scipy

            import_base_of_scipy()
            for needed in _MATHEMATICS:
                importlib.import_module(needed)
        module = f"{name}.service"
        package = find_spec(name)
        # `find_spec` of a submodule imports the package, so skip names that are not packages.
        if package is None or not package.submodule_search_locations:
            return
        if module not in sys.modules and find_spec(module) is not None:
            # An import that fails fails again in the service, whose log then has the reason.
            with suppress(Exception):
                importlib.import_module(module)

    def _tell_ended(channel: socket.socket) -> None:
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            _send(channel, {"ended": pid, "code": os.waitstatus_to_exitcode(status)})

    def _send(channel: socket.socket, message: dict[str, int]) -> None:
        channel.setblocking(True)
        try:
            channel.send(json.dumps(message).encode())
        except OSError:
            # The other process has ended; the loop ends with the socket.
            pass
        finally:
            channel.setblocking(False)

    def _become_service(request: dict[str, Any], life_line: int, inherited: tuple[socket.socket, ...]) -> NoReturn:
        """Run a service in this process, as `python -m NAME --config FILE` does, and end it."""
        code = 1
        gc.enable()
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.setsid()
            for end in inherited:
                end.close()
            log = os.open(request["log"], os.O_WRONLY | os.O_APPEND)
            for source, target in ((life_line, 0), (log, 1), (log, 2)):
                os.dup2(source, target)
            os.close(life_line)
            os.close(log)
            os.chdir(request["folder"])
            sys.path[0] = request["folder"]
            sys.argv = [request["name"], "--config", request["config"]]
            # Same title in the process list as without a fork.
            setproctitle(f"{sys.executable} -m {' '.join(sys.argv)}")
            setthreadtitle(request["name"])
            runpy.run_module(request["name"], run_name="__main__", alter_sys=True)
            code = 0
        except SystemExit as ended:
            code = _exit_code(ended)
        except BaseException:  # noqa: BLE001 - the process ends: any error is written to its log
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)

    def _exit_code(ended: SystemExit) -> int:
        if ended.code is None or isinstance(ended.code, int):
            return ended.code or 0
        sys.stderr.write(f"{ended.code}\n")
        return 1

    if __name__ == "__main__":
        main()
