"""A client of its own: plays a minute in real time and waits; the test kills it."""

import sys

import numpy as np

import duralab_bus
from duralab_proto.arrays import to_record
from duralab_proto.v1 import rig_pb2

endpoint, run = sys.argv[1:]
with duralab_bus.open_bus(duralab_bus.BusConfig(connect=(endpoint,)), service="client") as bus:
    bus.wait_for_live({("rig_sim", "front_axle_compliant")}, 120.0)
    description = bus.query(
        bus.keys.rig_description("front_axle_compliant"), rig_pb2.DescriptionRequest(), rig_pb2.RigDescription
    )
    drive = 0.005 * np.sin(2 * np.pi * np.arange(60_000) / 1000.0) * np.ones((6, 1))
    request = rig_pb2.PlayRequest(run=run, drive=to_record(description.drives, 1000.0, drive), real_time=True)
    bus.query(bus.keys.rig_play("front_axle_compliant"), request, rig_pb2.PlayResult)
