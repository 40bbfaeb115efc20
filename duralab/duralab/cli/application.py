"""The command line as typer sees it."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from duralab.cli.command_group import CommandGroup
from duralab.cli.exit_codes import MEANINGS

_EPILOG: Final = "Exit codes: " + "; ".join(f"{int(code)} {meaning}" for code, meaning in MEANINGS.items()) + "."

app = typer.Typer(
    name="duralab",
    cls=CommandGroup,
    help="A durability test lab: start it, run campaigns on its rigs, read what they recorded.",
    epilog=_EPILOG,
    invoke_without_command=True,
    add_completion=True,
    # Help in plain text: drawing it with rich takes as long again as everything else of `duralab --help`.
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _show_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"duralab {version('duralab')}")
        raise typer.Exit


@app.callback()
def _main(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    del version
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
