"""Play two rigs at once with `async`, and cancel a task: its rig ramps down and is latched.

python examples/two_rigs_at_once.py [ENDPOINT]
"""

import asyncio
import sys

import numpy as np

import duralab


async def main() -> None:
    async with duralab.async_connect(*sys.argv[1:2]) as lab:
        axle, car = await asyncio.gather(lab.describe("front_axle_compliant"), lab.describe("predecessor"))
        shake = np.zeros((len(axle.drives), 4000))
        # The predecessor is driven over a flat road at 15 m/s.
        road = np.stack([np.full(4000, 15.0 if name.endswith("speed") else 0.0) for name in names(car)])
        played = await asyncio.gather(lab.play(axle.name, shake), lab.play(car.name, road))
        for each in played:
            print(each)

        task = asyncio.create_task(lab.play(axle.name, np.zeros((len(axle.drives), 60_000)), real_time=True))
        await asyncio.sleep(0.5)
        task.cancel()
        print((await asyncio.gather(task, return_exceptions=True))[0].__class__.__name__)
        print(await lab.state(axle.name))
        print(await lab.reset(axle.name))


def names(rig: duralab.Rig) -> list[str]:
    return [channel.name for channel in rig.drives]


asyncio.run(main())
