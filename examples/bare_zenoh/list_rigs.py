"""List the rigs of a lab, with only Zenoh and the generated messages; docs/contract.md gives the reasons.

python examples/bare_zenoh/list_rigs.py [ENDPOINT]
"""

import sys
import time

import zenoh

from duralab_proto.v1 import query_pb2, rig_pb2

ROOT = "duralab/v1/local"

config = zenoh.Config()
config.insert_json5("mode", '"peer"')
config.insert_json5("connect/endpoints", f'["{[*sys.argv, "tcp/127.0.0.1:7474"][1]}"]')
config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')  # a peer without a listener receives nothing
config.insert_json5("scouting/multicast/enabled", "false")

with zenoh.open(config) as session:
    time.sleep(1.5)  # a new session takes about a second to find all members
    tokens = session.liveliness().get(f"{ROOT}/live/rig_sim/*")
    rigs = sorted({str(reply.ok.key_expr).rsplit("/", 1)[1] for reply in tokens if reply.ok is not None})
    for rig in rigs:
        replies = session.get(
            f"{ROOT}/rig/{rig}/description",
            payload=rig_pb2.DescriptionRequest().SerializeToString(),
            encoding="application/protobuf;duralab.v1.DescriptionRequest",
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=10.0,
        )
        for reply in replies:
            if reply.ok is None:
                print(f"{rig}: {query_pb2.Fault.FromString(reply.err.payload.to_bytes()).message}")
            elif str(reply.ok.encoding).endswith(".RigDescription"):
                described = rig_pb2.RigDescription.FromString(reply.ok.payload.to_bytes())
                print(f"{rig}: {described.specimen}, {described.sample_rate:g} Hz")
                for channel in described.drives:
                    print(f"  {channel.name}: {channel.minimum:g} to {channel.maximum:g} {channel.unit}")
