"""Rerun without pandas, which takes half a second of a processor to import."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Final

_PANDAS: Final = "pandas"


class _PandasLeftOut(MetaPathFinder):
    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Raise the error of a package that is not installed for pandas; leave all others to the next finders."""
        del path, target
        if name == _PANDAS:
            raise ModuleNotFoundError("pandas is left out of this process, which draws no tables of it.", name=name)
        return None


def leave_out_pandas() -> None:
    """Make imports of pandas fail in this process, as if it was not installed.

    Arrow, to which Rerun gives its values, imports pandas at the first of them, only to recognise its tables.
    """
    sys.meta_path.insert(0, _PandasLeftOut())
