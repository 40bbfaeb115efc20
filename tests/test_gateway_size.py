"""How much code a gateway to a new controller takes: that of the guide, which a test runs and check-rig judges."""

import re
import sys

from .documented import ROOT


def test_a_gateway_to_a_new_controller_takes_sixty_lines_at_most():
    page = (ROOT / "docs" / "guides" / "own-rig-gateway.md").read_text(encoding="utf-8")
    found = re.search(r"```python file=gateway\.py\n(.*?)```", page, re.DOTALL)
    assert found is not None
    lines = [line for line in found[1].splitlines() if line.strip()]
    sys.stdout.write(f"gateway.py of the guide: {len(lines)} lines\n")
    assert 20 < len(lines) <= 60
