"""The compose file as the tests read it: what each container is started with, after its anchors and variables."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
COMPOSE = ROOT / "deploy" / "compose" / "compose.yaml"
DOCKERFILE = ROOT / "deploy" / "images" / "Dockerfile"
_VARIABLE = re.compile(r"\$\{(\w+)(?::[-?]([^}]*))?\}")


@dataclass(frozen=True)
class Mounted:
    """A file of the host, or a volume by its name, and where it is in the container."""

    source: str
    target: str
    read_only: bool


@dataclass(frozen=True)
class Container:
    """What the compose file says of one container."""

    name: str
    command: list[str]
    environment: dict[str, str]
    user: int
    group: int
    read_only: bool
    tmpfs: dict[str, str]
    mounts: list[Mounted]
    health: list[str]


def compose_document(variables: Mapping[str, str]) -> dict[str, Any]:
    """Return the file with its variables put in; KeyError where one has no value and no default."""

    def put_in(match: re.Match[str]) -> str:
        name, default = match.groups()
        if name in variables:
            return variables[name]
        if default is None or ":?" in match[0]:
            raise KeyError(name)
        return default

    document: dict[str, Any] = yaml.safe_load(_VARIABLE.sub(put_in, COMPOSE.read_text()))
    return document


def containers(variables: Mapping[str, str]) -> dict[str, Container]:
    """Return the containers of the file by their names."""
    document = compose_document(variables)
    return {name: _container(name, service, document) for name, service in document["services"].items()}


def _container(name: str, service: dict[str, Any], document: dict[str, Any]) -> Container:
    user, group = service["user"].split(":")
    test = service["healthcheck"]["test"]
    assert test[0] == "CMD"
    return Container(
        name=name,
        command=[*service["entrypoint"], *service.get("command", [])],
        environment={key: str(value) for key, value in service.get("environment", {}).items()},
        user=int(user),
        group=int(group),
        read_only=service["read_only"],
        tmpfs=dict(entry.split(":") for entry in service["tmpfs"]),
        mounts=[*_files(service, document, "configs"), *_files(service, document, "secrets"), *_volumes(service)],
        health=test[1:],
    )


def _files(service: dict[str, Any], document: dict[str, Any], kind: str) -> list[Mounted]:
    return [
        Mounted(str(COMPOSE.parent / document[kind][one["source"]]["file"]), one["target"], read_only=True)
        for one in service.get(kind, [])
    ]


def _volumes(service: dict[str, Any]) -> list[Mounted]:
    named = (volume.split(":") for volume in service.get("volumes", []))
    return [Mounted(source, target, read_only=False) for source, target in named]


@dataclass(frozen=True)
class Stage:
    """One stage of the Dockerfile: what it is made from and its instructions, in their order."""

    name: str
    origin: str
    instructions: tuple[tuple[str, str], ...]

    def values(self, keyword: str) -> list[str]:
        """Return the arguments of all instructions of a kind."""
        return [argument for instruction, argument in self.instructions if instruction == keyword]


def stages() -> dict[str, Stage]:
    """Return the stages of the Dockerfile by their names."""
    text = re.sub(r"\\\n", " ", DOCKERFILE.read_text())
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    found: dict[str, Stage] = {}
    name, origin, instructions = "", "", list[tuple[str, str]]()
    for line in [*lines, "FROM end AS end"]:
        keyword, _, argument = line.partition(" ")
        if keyword != "FROM":
            instructions.append((keyword, argument.strip()))
            continue
        if name:
            found[name] = Stage(name, origin, tuple(instructions))
        (origin, _, name), instructions = argument.split(), []
    return found


def image_environment(stage: Stage, known: Mapping[str, Stage]) -> dict[str, str]:
    """Return the environment that an image sets, its own origin's first; `PATH` as it is written."""
    inherited = image_environment(known[stage.origin], known) if stage.origin in known else {}
    for argument in stage.values("ENV"):
        inherited |= dict(word.split("=", 1) for word in shlex.split(argument))
    return inherited
