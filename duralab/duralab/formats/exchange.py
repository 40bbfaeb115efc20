"""Reader and writer for all formats, chosen by the file's suffix or by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from duralab.data import Signals
from duralab.errors import InputError
from duralab.formats.errors import FormatError, Written
from duralab.near_files import did_you_mean
from duralab.output_files import replace_when_complete, require_outputs
from duralab_settings import Plugin, SettingsError, load_plugin, one_line, plugin_names

if TYPE_CHECKING:
    from duralab_drive_files import DataType


class Format(StrEnum):
    """File format of signals."""

    RPC3 = "rpc3"
    MDF4 = "mdf4"
    UFF58 = "uff58"
    TDMS = "tdms"
    MAT = "mat"
    CSV = "csv"
    PARQUET = "parquet"


@dataclass(frozen=True)
class _Codec:
    """Reader and writer of a format ("module:function"), imported at their first use."""

    reader: str
    writer: str
    suffixes: tuple[str, ...]


_CODECS: Final = {
    Format.RPC3: _Codec("rpc3:read_rpc3", "rpc3:write_rpc3", (".rsp", ".drv", ".tim", ".rpc", ".rpc3")),
    Format.MDF4: _Codec("mdf4:read_mdf4", "mdf4:write_mdf4", (".mf4", ".mdf")),
    Format.UFF58: _Codec("uff58:read_uff58", "uff58:write_uff58", (".uff", ".unv")),
    Format.TDMS: _Codec("tdms:read_tdms", "tdms:write_tdms", (".tdms",)),
    Format.MAT: _Codec("matlab:read_mat", "matlab:write_mat", (".mat",)),
    Format.CSV: _Codec("csv_text:read_csv", "csv_text:write_csv", (".csv", ".txt")),
    Format.PARQUET: _Codec("parquet:read_parquet", "parquet:write_parquet", (".parquet", ".pq")),
}


GROUP: Final = "duralab.formats"
"""Entry-point group of plug-ins; each entry names a `FormatPlugin`."""


@dataclass(frozen=True)
class FormatPlugin:
    """File format of an installed distribution, given as an entry point of the group `duralab.formats`.

    Parameters
    ----------
    suffixes : tuple of str
        Suffixes of its files, lower case, with the dot; a shipped format has priority for its suffixes.
    reader : callable
        Returns the `Signals` of a file at a path; raises `FormatError` if it cannot read the file.
    writer : callable, optional
        Writes `Signals` to a path and returns `Written`; not given for a read-only format.
    """

    suffixes: tuple[str, ...]
    reader: Callable[[Path], Signals]
    writer: Callable[[Signals, Path], Written] | None = None


def _plugin(name: str) -> Plugin:
    """Load the plug-in of a format and check its type."""
    try:
        found = load_plugin(GROUP, name, field="format", shipped=list(Format))
    except SettingsError as error:
        raise InputError(str(error), field="format") from error
    if not isinstance(found.content, FormatPlugin):
        raise InputError(
            f"The format plug-in {name!r} of {found.source} is {type(found.content).__name__}; its entry point must "
            "name a duralab.formats.FormatPlugin.",
            field="format",
        )
    return found


def _plugin_of_suffix(suffix: str) -> str | None:
    """Return the name of the plug-in for a suffix; None if there is none."""
    found, faults = [], []
    for name in plugin_names(GROUP):
        try:
            if suffix in _plugin(name).content.suffixes:
                found.append(name)
        except InputError as error:
            faults.append(error)
    # A plug-in that cannot be loaded must not block other plug-ins.
    if faults and not found:
        raise faults[0]
    if len(found) > 1:
        raise InputError(
            f"Files with the suffix {suffix!r} are of the formats {' and '.join(found)}; name one: format={found[0]}.",
            field="format",
        )
    return found[0] if found else None


def format_of(path: Path, given: str | None) -> str:
    """Return the given format, or the one of the suffix.

    Parameters
    ----------
    path : Path
        Path of the file.
    given : str or None
        Name of a format, or None.

    Returns
    -------
    str
        A `Format`, or the name of a plug-in.

    Raises
    ------
    InputError
        The format or suffix is unknown, or a plug-in cannot be loaded.
    """
    if given is not None:
        if given.lower() in list(Format):
            return Format(given.lower())
        if given in (plugins := plugin_names(GROUP)):
            return given
        raise InputError(f"format is {given!r}; {', '.join((*Format, *plugins))} are known.", field="format")
    for known, codec in _CODECS.items():
        if path.suffix.lower() in codec.suffixes:
            return known
    if (plugin := _plugin_of_suffix(path.suffix.lower())) is not None:
        return plugin
    suffixes = ", ".join(suffix for codec in _CODECS.values() for suffix in codec.suffixes)
    raise InputError(
        f"{path} has the suffix {path.suffix!r}; {suffixes} are known, or name the format: "
        f"{', '.join((*Format, *plugin_names(GROUP)))}.",
        field="format",
    )


def _function(place: str) -> Callable[..., Any]:
    module, _, name = place.partition(":")
    return getattr(import_module(f"duralab.formats.{module}"), name)


def read_signals(path: str | Path, *, format: str | None = None) -> Signals:
    """Read signals from a file.

    Parameters
    ----------
    path : str or Path
        File in RPC III, MDF 4, UFF 58, TDMS, MATLAB level 5, CSV or Parquet.
    format : str, optional
        Value of `Format` or name of a plug-in; chosen by the suffix if not given.

    Returns
    -------
    Signals
        All channels in the units of the file, float64; other information of the file is in `attributes`.

    Raises
    ------
    FormatError
        The file is damaged or not of the format; states the file, the byte if known, and the expected content.
    InputError
        The format is unknown, or its library is not installed.
    """
    path = Path(path)
    # Check a given format first; check the suffix only after the file, because the suffix may be mistyped.
    form = None if format is None else format_of(path, format)
    _require_there(path)
    form = form or format_of(path, None)
    if isinstance(form, Format):
        return _function(_CODECS[form].reader)(path)
    return _read_by_plugin(_plugin(form), path)


def _read_by_plugin(plugin: Plugin, path: Path) -> Signals:
    name = f"the format plug-in {plugin.name!r} of {plugin.source}"
    try:
        signals = plugin.content.reader(path)
    except InputError:
        raise
    except Exception as error:
        raise FormatError(path, f"{name} raised {one_line(error)}; correct the file or the plug-in.") from error
    if not isinstance(signals, Signals):
        raise FormatError(path, f"{name} returned {type(signals).__name__}; it must return Signals.")
    samples = np.asarray(signals.samples)
    if samples.ndim != 2 or samples.shape[0] != len(signals.channels) or not np.isfinite(samples).all():
        raise FormatError(
            path,
            f"{name} returned samples of shape {samples.shape} for {len(signals.channels)} channels; it must return "
            "finite samples of the shape (channels, samples).",
        )
    return signals


def _writer(form: str) -> Callable[..., Written]:
    """Return the writer of a format; errors of a plug-in name the plug-in."""
    if isinstance(form, Format):
        return _function(_CODECS[form].writer)
    plugin = _plugin(form)
    name = f"the format plug-in {plugin.name!r} of {plugin.source}"
    if plugin.content.writer is None:
        raise InputError(f"T{name[1:]} only reads; write another format.", field="format")

    def write(signals: Signals, path: Path) -> Written:
        try:
            written = plugin.content.writer(signals, path)
        except InputError:
            raise
        except Exception as error:
            raise FormatError(path, f"{name} raised {one_line(error)}; correct the plug-in.") from error
        if not isinstance(written, Written) or not path.is_file():
            raise FormatError(
                path, f"{name} wrote no file or returned {type(written).__name__}; it must write it and return Written."
            )
        return written

    return write


def _require_there(path: Path) -> None:
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FormatError(path, f"there is no such file; give a file of signals{did_you_mean(path)}") from error
    except (OSError, ValueError):
        return  # The reader reports the error.


def write_signals(
    signals: Signals,
    path: str | Path,
    *,
    format: str | None = None,
    overwrite: bool = False,
    data_type: DataType | str | None = None,
) -> Written:
    """Write signals to a file atomically.

    Parameters
    ----------
    signals : Signals
        Signals with at least one channel and one sample, all finite.
    path : str or Path
        Path of the output.
    format : str, optional
        Value of `Format` or name of a plug-in; chosen by the suffix if not given.
    overwrite : bool
        Whether to replace an existing file.
    data_type : str, optional
        For RPC III: "SHORT_INTEGER" (the default) or "FLOATING_POINT".

    Returns
    -------
    Written
        Path, and losses of the format: padding, quantisation error, notes.

    Raises
    ------
    InputError
        The file already exists, or the format cannot store these signals.
    """
    from duralab.formats.columns import LEFT_OUT

    path = Path(path)
    form = format_of(path, format)
    _require_writable(signals, path)
    # The sentence is about the file that was read; the new one holds all channels.
    signals = replace(signals, attributes={key: text for key, text in signals.attributes.items() if key != LEFT_OUT})
    arguments = (_rpc3_settings(data_type, form),) if data_type is not None else ()
    require_outputs([path], replace=overwrite)
    writer = _writer(form)
    with replace_when_complete(path) as temporary:
        # The writer needs the suffix (drive or response), and a name different from the temporary one.
        named = temporary.with_name(f"{temporary.name}.written{path.suffix}")
        try:
            written = writer(signals, named, *arguments)
            named.replace(temporary)
        finally:
            named.unlink(missing_ok=True)
    return replace(written, path=path)


def _rpc3_settings(data_type: str, form: str) -> object:
    from duralab_drive_files import DataType, Rpc3Settings

    if form is not Format.RPC3:
        raise InputError(f"data_type is {data_type!r}; only rpc3 has a choice, so leave it out.", field="data_type")
    try:
        return Rpc3Settings(data_type=DataType(data_type.upper()))
    except ValueError:
        raise InputError(f"data_type is {data_type!r}; {', '.join(DataType)} are known.", field="data_type") from None


def _require_writable(signals: Signals, path: Path) -> None:
    samples = signals.samples
    if samples.ndim != 2 or samples.shape[0] != len(signals.channels) or samples.size == 0:
        raise InputError(
            f"{path} cannot be written: samples has the shape {samples.shape} and there are {len(signals.channels)} "
            "channels; (channels, samples) with one of each or more is needed."
        )
    if not (0 < signals.sample_rate < np.inf):
        raise InputError(f"{path} cannot be written: sample_rate is {signals.sample_rate}; it must be greater than 0.")
    for channel, row in zip(signals.channels, samples, strict=True):
        if not np.isfinite(row).all():
            sample = int(np.argmin(np.isfinite(row)))
            raise InputError(
                f"{path} cannot be written: sample {sample} of {channel.name} is {row[sample]}; it must be finite."
            )
