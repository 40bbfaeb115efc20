"""Plug-ins: objects of installed distributions under the name of an entry point."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from duralab_settings.values import SettingsError


@dataclass(frozen=True)
class Plugin:
    """Loaded plug-in.

    Parameters
    ----------
    name : str
        Name of its entry point.
    source : str
        Distribution and version of the plug-in, e.g. "duralab-momentum 1.0".
    content : object
        Object that the entry point names.
    """

    name: str
    source: str
    content: Any


def plugin_names(group: str) -> tuple[str, ...]:
    """Return the names of all installed plug-ins of a group, sorted.

    Parameters
    ----------
    group : str
        Group of entry points, e.g. "duralab.updates".

    Returns
    -------
    tuple of str
        Names, each once; the plug-ins are not imported.
    """
    return tuple(sorted({entry.name for entry in entry_points(group=group)}))


def load_plugin(group: str, name: str, *, field: str, shipped: Collection[str] = ()) -> Plugin:
    """Load the plug-in of a name.

    Parameters
    ----------
    group : str
        Group of entry points, e.g. "duralab.updates".
    name : str
        Name of the entry point.
    field : str
        Key that names it, for errors.
    shipped : collection of str
        Names that a plug-in must not have.

    Returns
    -------
    Plugin
        Imported plug-in, not checked any further.

    Raises
    ------
    SettingsError
        No distribution or more than one has the name, the name is a shipped one, or the import fails.
    """
    found = [entry for entry in entry_points(group=group) if entry.name == name]
    if not found:
        names = ", ".join(plugin_names(group)) or "none"
        raise SettingsError(
            f"{field} is {name!r}; installed plug-ins of {group} are {names}: correct the name, or install the plug-in "
            "where it is loaded.",
            field=field,
        )
    sources = sorted(_source(entry) for entry in found)
    if len(found) > 1:
        raise SettingsError(
            f"{field} is {name!r}, which {' and '.join(sources)} offer in {group}; keep one and uninstall the others.",
            field=field,
        )
    if name in shipped:
        raise SettingsError(
            f"{field} is {name!r}, a name that ships with Duralab, and {sources[0]} offers it in {group} too; rename "
            "the plug-in.",
            field=field,
        )
    try:
        content = found[0].load()
    except Exception as error:
        raise SettingsError(
            f"The plug-in {name!r} of {sources[0]} cannot be imported: {one_line(error)}; correct or reinstall it.",
            field=field,
        ) from error
    return Plugin(name, sources[0], content)


def one_line(error: BaseException) -> str:
    """Return the type and message of a plug-in's error in one line.

    Parameters
    ----------
    error : BaseException
        Raised error.

    Returns
    -------
    str
        Text of at most 300 characters, without a full stop.
    """
    text = " ".join(str(error).split()).rstrip(".")
    return f"{type(error).__name__}: {text}"[:300] if text else type(error).__name__


def _source(entry: EntryPoint) -> str:
    distribution = entry.dist
    return "an unknown distribution" if distribution is None else f"{distribution.name} {distribution.version}"
