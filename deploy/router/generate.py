"""Write deploy/router/zenohd.json5 from the access table and members.yaml, or check that it is fresh."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from duralab.security import read_members
from duralab_bus import router_configuration

ROOT = Path(__file__).resolve().parents[2]
CONFIGURATION = Path(__file__).with_name("zenohd.json5")


def locked_version() -> str:
    """Return the version of Zenoh in requirements.lock: router and clients have the same one."""
    found = re.search(r"(?m)^eclipse-zenoh==(\S+)", (ROOT / "requirements.lock").read_text(encoding="utf-8"))
    if found is None:
        raise SystemExit("requirements.lock pins no eclipse-zenoh; run `make lock`.")
    return found[1]


def main() -> int:
    """Parse the command line and write or check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="only check that the committed configuration is current")
    members = [entry.member for entry in read_members(CONFIGURATION.with_name("members.yaml"))]
    content = router_configuration(members, version=locked_version())
    if parser.parse_args().check:
        if CONFIGURATION.is_file() and CONFIGURATION.read_text(encoding="utf-8") == content:
            return 0
        sys.stderr.write(
            "deploy/router/zenohd.json5 is not what the access table gives; run `make proto`, commit it.\n"
        )
        return 1
    CONFIGURATION.write_text(content, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
