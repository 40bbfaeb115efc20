"""`python -m rig_sim --config FILE`: run the rig simulator until it is asked to end.

`--list` prints the titles of the shipped rigs, `--specimens` the content of their files; both as JSON.
"""

import json
import sys

from duralab_bus import HostedService, service_main
from duralab_gateway import SERVICE
from rig_sim.loading import shipped_documents, shipped_titles
from rig_sim.service import RigSimConfig, serve

# The rigs declare themselves live: their names are in the specimens' files, not in the configuration.
HOSTED = HostedService(SERVICE, RigSimConfig, lambda config: lambda bus: serve(bus, config), instances=())
"""The rig simulator as one of several services in a process."""

if __name__ == "__main__":
    listings = {"--list": shipped_titles, "--specimens": shipped_documents}
    if len(sys.argv) == 2 and sys.argv[1] in listings:
        sys.stdout.write(json.dumps(listings[sys.argv[1]](), indent=2) + "\n")
        raise SystemExit(0)
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build, instances=lambda _: HOSTED.instances)
