"""The command line as typer sees it: commands by sections, each imported when it is used."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, cast

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from duralab.cli.commands import SECTIONS, command_function
from duralab.cli.ending import MEANINGS, ExitCode, ended_well, fail

_NAMES: Final = [name for names in SECTIONS.values() for name in names]


class _Commands(Mapping[str, TyperCommand | TyperGroup]):
    """All commands that begin with some words, by the word that follows, each made when it is asked for."""

    def __init__(self, words: str = "") -> None:
        self._words = words

    def __getitem__(self, name: str) -> TyperCommand | TyperGroup:
        path = self._words + name
        inner = _Commands(f"{path} ")
        if path not in _NAMES and len(inner):
            listed = ", ".join(inner)
            group = TyperGroup(name=name, help=f"One of {listed}.", rich_markup_mode=None)
            group.commands = inner  # type: ignore[assignment]  (it is only read)
            return group
        # Looked up first: only a name that no command has is a KeyError.
        function = command_function(path)
        single = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
        single.command(name)(function)
        # One function makes one command.
        return cast("TyperCommand", get_command(single))

    def __iter__(self) -> Iterator[str]:
        inside = [name.removeprefix(self._words) for name in _NAMES if name.startswith(self._words)]
        return iter(dict.fromkeys(name.partition(" ")[0] for name in inside))

    def __len__(self) -> int:
        return sum(1 for _ in self)


class CommandGroup(TyperGroup):
    """All commands of `duralab`; every error ends in one sentence and one of the documented exit codes."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Commands()  # type: ignore[assignment]  (it is only read)
        self._as_json = False

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """Return the names of all commands, in the order of the sections."""
        del ctx
        return list(self.commands)

    def format_commands(self, ctx: typer.Context, formatter: Any) -> None:  # type: ignore[override]
        """Write a line for each command: the first of its function's docstring."""
        del ctx
        for section, commands in SECTIONS.items():
            with formatter.section(section):
                formatter.write_dl(
                    [(name, (command_function(name).__doc__ or "").splitlines()[0]) for name in commands]
                )

    def invoke(self, ctx: typer.Context) -> Any:  # type: ignore[override]
        """Run the command that was asked for."""
        with ended_well(as_json=self._as_json):
            return super().invoke(ctx)  # type: ignore[arg-type]

    def main(  # type: ignore[override]
        self, args: Sequence[str] | None = None, prog_name: str | None = None, **settings: Any
    ) -> Any:
        """Run a command line and exit with its code."""
        self._as_json = "--json" in (sys.argv[1:] if args is None else args)
        try:
            code = super().main(args, prog_name, **{**settings, "standalone_mode": False})
        except typer.TyperException as error:
            try:
                fail(_usage_sentence(error), ExitCode.USER_ERROR, as_json=self._as_json)
            except typer.Exit as ending:
                code = ending.exit_code
        except SystemExit as ending:
            # Help and version are written before there is a command; typer ends so if their reader is gone.
            code = ExitCode.OUTPUT_CLOSED if isinstance(ending.__context__, BrokenPipeError) else ending.code
        except OSError as error:
            try:
                sentence = f"The output cannot be written: {error.strerror or error}; free space, or send it elsewhere."
                fail(sentence, ExitCode.FAILED, as_json=self._as_json)
            except typer.Exit as ending:
                code = ending.exit_code
        except typer.Abort:
            code = ExitCode.INTERRUPTED
        sys.exit(code if isinstance(code, int) else ExitCode.DONE)


def _usage_sentence(error: typer.TyperException) -> str:
    context = getattr(error, "ctx", None)
    # The words of a Python error inside the sentence are none of the user's.
    sentence = " ".join(error.format_message().split()).replace(": Value error, ", ": ").rstrip(".")
    # Pydantic, which converts the values, does not repeat them.
    findings = getattr(error.__cause__, "errors", None)
    if findings is not None:
        sentence = f"{sentence}, got {findings()[0]['input']!r}"
    if context is None:
        return f"{sentence}."
    return f"{sentence}{'' if sentence.endswith('?') else ';'} `{context.command_path} --help` shows what is allowed."


_EPILOG: Final = "Exit codes: " + "; ".join(f"{int(code)} {meaning}" for code, meaning in MEANINGS.items()) + "."

app = typer.Typer(
    name="duralab",
    cls=CommandGroup,
    help="A durability test lab: start it, run campaigns on its rigs, read their recordings.",
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
