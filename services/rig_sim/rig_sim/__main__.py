"""`python -m rig_sim --config FILE`: run the rig simulator until it is told to end. `--list`: name the shipped rigs."""

import json
import sys

from labbus import service_main
from rig_sim.loading import shipped_titles
from rig_sim.service import SERVICE, RigSimConfig, serve

if __name__ == "__main__":
    if sys.argv[1:] == ["--list"]:
        sys.stdout.write(json.dumps(shipped_titles(), indent=2) + "\n")
        raise SystemExit(0)
    # The rigs declare themselves live: a specimen's file says its name, the configuration does not.
    service_main(SERVICE, RigSimConfig, lambda config: lambda bus: serve(bus, config), instances=lambda _: ())
