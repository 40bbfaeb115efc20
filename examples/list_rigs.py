"""List the rigs of a lab, with their limits and their present state.

python examples/list_rigs.py [ENDPOINT]
"""

import sys

import duralab

with duralab.connect(*sys.argv[1:2]) as lab:
    rigs = lab.rigs()
    print(rigs)
    for rig in rigs:
        print(f"\n{rig}\n{lab.state(rig.name)}")
