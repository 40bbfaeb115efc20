"""Compare two update algorithms on one target: the same rig, seed and experiment, only the update differs.

python examples/compare_algorithms.py [ENDPOINT]
"""

import sys
from pathlib import Path

import duralab

campaign = duralab.load_campaign(Path(__file__).with_name("short_campaign.yaml"))

recordings = []
with duralab.connect(*sys.argv[1:2]) as lab:
    for algorithm in ("secant", "basic_twr"):
        update = {"kind": algorithm, "accept_segments": algorithm == "secant"}
        document = campaign.model_dump(mode="json", exclude_unset=True)
        document["update"] |= update
        document["name"] = algorithm
        result = lab.run(duralab.Campaign.model_validate(document), out=f"out/{algorithm}")
        recordings.append(result.recording)
        print(f"{algorithm}: overall relative RMS error", *(f"{error:.3f}" for error in result.iterations.overall))

print(duralab.compare(*recordings))
