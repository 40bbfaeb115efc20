"""Rehearse a campaign with drive and response files; a separate controller plays them on a simulated rig.

python examples/file_exchange/rehearse.py [OUT]
"""

import itertools
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import duralab
from duralab.testing import FileController, file_gateway
from duralab_drive_files import read_controller_map

HERE = Path(__file__).parent
SIMULATED = "front_axle"


def main(out: Path) -> int:
    shutil.rmtree(out / "exchange", ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    path = Path(shutil.copy(HERE / "front_axle_controller.yaml", out))
    controller_map = read_controller_map(path)
    seeds = itertools.count()
    with (
        duralab.start(rigs=[SIMULATED, "predecessor"], out=out / "lab") as lab,
        file_gateway(path, lab.endpoints[0], folder=out / "gateway"),
    ):
        # A delay of 37.4 samples, a gain error of 0.5 %, another rate and 16 bits, as with a good controller.
        controller = FileController(
            controller_map,
            lambda drive: lab.play(SIMULATED, drive, seed=next(seeds)).response.samples,
            response_rate=2048.0,
        )
        thread = threading.Thread(target=controller.run)
        thread.start()
        try:
            command = ["duralab", "run", str(HERE / "campaign.yaml"), "--connect", lab.endpoints[0], "--replace"]
            code = subprocess.run(
                [sys.executable, "-m", *command, "--out", str(out / "campaign")], check=False
            ).returncode
        finally:
            controller.end()
            thread.join()
    done = controller_map.exchange / "outbox" / "done"
    print(f"\n{len(controller.played_runs)} drive files were played; they are in {done}")
    return code


if __name__ == "__main__":
    sys.exit(main(Path(*sys.argv[1:2] or ["out/demo_real"])))
