"""`python -m rig_sim --config FILE`: run the rig simulator until it is told to end."""

from labbus import service_main
from rig_sim.service import SERVICE, RigSimConfig, serve

if __name__ == "__main__":
    # The rigs declare themselves live: a specimen's file says its name, the configuration does not.
    service_main(SERVICE, RigSimConfig, lambda config: lambda bus: serve(bus, config), instances=lambda _: ())
