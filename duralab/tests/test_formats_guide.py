"""What the guide to the formats says of them; tests of the documented guides run its script and commands."""

import re
from pathlib import Path

from duralab.formats import Format, format_of

GUIDE = (Path(__file__).resolve().parents[2] / "docs" / "guides" / "formats.md").read_text(encoding="utf-8")


def test_the_table_of_the_guide_lists_every_format_with_its_suffixes():
    rows = re.findall(r"^\| .*\(`(\w+)`\) \| (.*?) \|", GUIDE, flags=re.M)
    assert [name for name, _ in rows] == list(Format)
    for name, suffixes in rows:
        assert {format_of(Path(f"a{suffix}"), None) for suffix in re.findall(r"`(\.\w+)`", suffixes)} == {name}
