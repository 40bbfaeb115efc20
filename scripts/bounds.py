"""Compare each lower bound of the distributions with the installed version: a part of `make lowest`.

A bound below every version that can be installed together with the others was never tested, so it is an error.
"""

from __future__ import annotations

import sys
from importlib.metadata import PackageNotFoundError, distributions, version

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version


def bounds() -> dict[str, Version]:
    """Return the lower bound of every package that an installed distribution of Duralab needs."""
    found: dict[str, Version] = {}
    for distribution in distributions():
        if not distribution.metadata["Name"].startswith("duralab"):
            continue
        for text in distribution.requires or ():
            requirement = Requirement(text)
            lowest = [Version(part.version) for part in requirement.specifier if part.operator == ">="]
            if not requirement.name.startswith("duralab") and lowest:
                name = canonicalize_name(requirement.name)
                found[name] = max(found.get(name, lowest[0]), lowest[0])
    return found


def main() -> int:
    """Print bounds and installed versions; 1 if they differ."""
    wrong = []
    for name, bound in sorted(bounds().items()):
        try:
            installed = Version(version(name))
        except PackageNotFoundError:
            # The package is of an extra that is not tested.
            continue
        sys.stdout.write(f"{name:<20} >= {bound!s:<10} installed {installed}\n")
        if installed != bound:
            wrong.append(f"{name}>={bound} was installed as {installed}")
    if wrong:
        sys.stderr.write(f"{'; '.join(wrong)}: raise each bound to the version that is tested.\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
