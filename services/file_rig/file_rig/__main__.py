"""`python -m file_rig --config FILE`: serve the rigs of controller maps until it is asked to end."""

from duralab_bus import HostedService, service_main
from duralab_gateway import SERVICE
from file_rig.service import FileRigConfig, serve

# The rigs declare themselves live: their names are in the maps, not in the configuration.
HOSTED = HostedService(SERVICE, FileRigConfig, lambda config: lambda bus: serve(bus, config), instances=())
"""The file rig as one of several services in a process."""

if __name__ == "__main__":
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build, instances=lambda _: HOSTED.instances)
