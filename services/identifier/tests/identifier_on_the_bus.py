"""The identifier and linear rigs as processes on a test's bus."""

import importlib.util
import subprocess
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

import yaml

LINEAR_RIG = Path(__file__).with_name("linear_rig.py")


def load_linear_rig():
    spec = importlib.util.spec_from_file_location("linear_rig", LINEAR_RIG)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextmanager
def process(bus, lab, folder, *command, **config):
    file = folder / f"{Path(command[-1]).stem}_{config.get('rig', 'main')}.yaml"
    settings = {"bus": {"lab": lab, "connect": list(bus.listening)}, "exit_with_parent": True, **config}
    file.write_text(yaml.safe_dump(settings))
    with subprocess.Popen(
        [sys.executable, *command, "--config", str(file)], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as running:
        try:
            yield running
        finally:
            running.terminate()
            try:
                running.wait(5.0)
            except subprocess.TimeoutExpired:
                running.kill()


@contextmanager
def identifier_and_rigs(bus, lab, folder, *, rigs, **config):
    """Yield the rigs' processes by name once all are live."""
    with ExitStack() as stack:
        stack.enter_context(process(bus, lab, folder, "-m", "identifier", **config))
        running = {name: stack.enter_context(process(bus, lab, folder, str(LINEAR_RIG), rig=name)) for name in rigs}
        bus.wait_for_live(
            {("identifier", "main"), *(("rig_sim", name) for name in (*rigs, "failing", "mistaken"))}, 120.0
        )
        yield running
