"""The command line's reference, from the commands themselves."""

from __future__ import annotations

from typing import Any

from table_cells import cell
from typer.main import get_command

from duralab.cli.application import app
from duralab.cli.commands import SECTIONS

_HELP = "--help"
_VALUE = "VALUE"


def commands_page() -> str:
    """Return the page: usage, arguments and options of every command."""
    program: Any = get_command(app)
    parts = [
        "# Command line\n",
        f"{program.help}\n",
        "Made from the commands; `duralab COMMAND --help` says the same in a terminal.\n",
    ]
    if program.epilog:
        parts.append(f"{program.epilog}\n")
    for section, names in SECTIONS.items():
        parts.append(f"## {section}\n")
        parts += [_command(_found(program, name), f"{program.name} {name}") for name in names]
    return "\n".join(parts)


def _found(group: Any, name: str) -> Any:
    for word in name.split():
        group = group.commands[word]
    return group


def _command(command: Any, path: str) -> str:
    parameters = [parameter for parameter in command.params if _HELP not in parameter.opts and not parameter.hidden]
    arguments = [_argument(parameter) for parameter in parameters if _is_argument(parameter)]
    usage = " ".join([path, "[OPTIONS]", *arguments])
    lines = [f"### {path}\n", f"{cell(command.help or '')}\n", f"```text\n{usage}\n```\n"]
    if parameters:
        lines += ["| | default | |", "| --- | --- | --- |", *(_row(parameter) for parameter in parameters), ""]
    return "\n".join(lines)


def _is_argument(parameter: Any) -> bool:
    return parameter.param_type_name == "argument"


def _argument(parameter: Any) -> str:
    name = parameter.metavar or parameter.name.upper()
    return name if parameter.required else f"[{name}]"


def _row(parameter: Any) -> str:
    if _is_argument(parameter):
        name = f"`{_argument(parameter)}`"
    else:
        value = "" if parameter.is_flag else f" {parameter.metavar or _VALUE}"
        name = ", ".join(f"`{option}{value}`" for option in (*parameter.opts, *parameter.secondary_opts))
    default = "required" if parameter.required else _default(parameter.default)
    return f"| {name} | {default} | {cell(parameter.help or '')} |"


def _default(default: Any) -> str:
    if default is None or default is False or callable(default) or str(default) in ("", "()", "[]"):
        return ""
    return f"`{cell(str(default))}`"
