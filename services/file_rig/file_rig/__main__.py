"""`python -m file_rig --config FILE`: serve the rigs of controller maps until it is asked to end."""

from duralab_bus import HostedService, service_main
from duralab_gateway import SERVICE
from file_rig.service import FileRigConfig, serve

# The rigs declare themselves live: a map says its rig's name, the configuration does not.
HOSTED = HostedService(SERVICE, FileRigConfig, lambda config: lambda bus: serve(bus, config), instances=())
"""The service as one of several in a process."""

if __name__ == "__main__":
    service_main(HOSTED.name, HOSTED.config_type, HOSTED.build, instances=lambda _: HOSTED.instances)
