"""`duralab info`, `import` and `convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from duralab.cli.options import Connect, DataType, FileFormat, Json, Replace, Unit, complete_rig

Source = Annotated[Path, typer.Argument(metavar="IN", help="A file of signals.")]
Out = Annotated[Path, typer.Argument(metavar="OUT", help="The file to write.")]
FromFormat = Annotated[
    str | None, typer.Option("--from-format", metavar="FORMAT", help="Of IN; by suffix if left out.")
]


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A file of signals, or a recording.mcap.")],
    *,
    from_format: Annotated[
        str | None, typer.Option("--from-format", metavar="FORMAT", help="Of FILE; by suffix if left out.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what a file of signals or a recording holds: channels, range, RMS, spectrum; campaign and playbacks."""
    from duralab.cli.info_command import info as show

    show(file, from_format=from_format, as_json=as_json)


def import_file(
    source: Source,
    out: Out,
    *,
    rig: Annotated[
        str,
        typer.Option("--rig", metavar="RIG", help="Whose responses are wanted.", autocompletion=complete_rig),
    ],
    settings: Annotated[
        Path | None,
        typer.Option(
            "--settings", metavar="FILE", help="YAML with `channels` and `edit`, as under `target` of a campaign file."
        ),
    ] = None,
    to_format: FileFormat = None,
    connect: Connect = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Make a target of a measured file: its channels as a rig's responses, in its units, edited, told step by step."""
    from duralab.cli.import_command import import_target

    import_target(
        source,
        out,
        rig=rig,
        settings=settings,
        to_format=to_format,
        endpoint=connect,
        replace=replace,
        as_json=as_json,
    )


def convert(
    source: Source,
    out: Out,
    *,
    from_format: FromFormat = None,
    to_format: FileFormat = None,
    unit: Unit = None,
    rate: Annotated[float | None, typer.Option("--rate", metavar="HZ", help="Resample to this rate.")] = None,
    data_type: DataType = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Convert a file of signals to another format, and to other units or another sample rate."""
    from duralab.cli.convert_command import convert as go

    go(
        source,
        out,
        from_format=from_format,
        to_format=to_format,
        units=unit or [],
        rate=rate,
        data_type=data_type,
        replace=replace,
        as_json=as_json,
    )
