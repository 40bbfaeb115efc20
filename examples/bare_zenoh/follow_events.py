"""Follow a lab live: rig states, signal blocks and campaigns, with only Zenoh and the generated messages.

python examples/bare_zenoh/follow_events.py [ENDPOINT SECONDS]
"""

import struct
import sys
import time

import zenoh

from duralab_proto.v1 import iterator_pb2, rig_pb2

ROOT = "duralab/v1/local"
KINDS = {
    f"{ROOT}/rig/*/state": rig_pb2.RigState,
    f"{ROOT}/rig/*/signal/*": rig_pb2.SignalBlock,
    f"{ROOT}/iterator/event/*": iterator_pb2.CampaignEvent,
}
endpoint, seconds = sys.argv[1:] or ("tcp/127.0.0.1:7474", "60")
expected: dict[tuple[str, int], int] = {}


def tell(sample: zenoh.Sample, kind: type) -> None:
    """Print one message, and the number of messages lost before it; epoch and number are attached to each."""
    epoch, number = struct.unpack("<QQ", sample.attachment.to_bytes())
    key = str(sample.key_expr)
    lost = number - expected.get((key, epoch), number)
    expected[key, epoch] = number + 1
    message = kind.FromString(sample.payload.to_bytes())
    match message:
        case rig_pb2.RigState():
            words = f"{rig_pb2.RigMode.Name(message.mode)} {message.run} {message.reason}"
        case rig_pb2.SignalBlock():
            words = f"samples from {message.first_sample}{', the last' if message.last else ''}"
        case _:
            words = f"{message.status.activity} ({100 * message.status.fraction:.0f} %)"
    print(f"{key.removeprefix(ROOT)}: {words}{f', {lost} lost before' if lost else ''}", flush=True)


config = zenoh.Config()
config.insert_json5("mode", '"peer"')
config.insert_json5("connect/endpoints", f'["{endpoint}"]')
config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')  # a peer without a listener receives nothing
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    held = [session.declare_subscriber(key, lambda s, kind=kind: tell(s, kind)) for key, kind in KINDS.items()]
    print("listening", flush=True)
    time.sleep(float(seconds))
