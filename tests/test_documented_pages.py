"""What all pages have in common: blocks that say what is done with them, links and commands that are there."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest
from documented import OWN_TESTS, ROOT, SHOWN, Fence, fences, pages, words_of
from typer.main import get_command

from duralab.cli.application import app

PAGES = pages()
RUN = {"console", "python", "yaml"}
OPTIONS = {"exit", "background", "file", "not-run", "output", "part-of"}
FENCED = re.compile(r"^(`{3,}).*?^\1$", flags=re.M | re.S)
LINK = re.compile(r"!?\[(?P<text>[^\]]*)\]\((?P<target>[^)\s]+)\)")
INLINE = re.compile(r"(?<!`)`(duralab [^`]+|make [^`]+)`(?!`)")
MADE_WITH_THE_SITE = {"python.md", "commands.md", "campaign-file.md", "messages.md"}
PROGRAM: Any = get_command(app)


def prose(page: str) -> str:
    return FENCED.sub("", (ROOT / page).read_text(encoding="utf-8"))


def anchors(path: Path) -> set[str]:
    """Anchors of a page's headings, as its readers' programs make them."""
    found: set[str] = set()
    for heading in re.findall(r"^#{1,6} (.*)$", FENCED.sub("", path.read_text(encoding="utf-8")), flags=re.M):
        name = re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()).strip()
        found.add(re.sub(r"\s", "-", name))
    return found


def definitions(path: Path) -> set[str]:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return {node.name for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, kinds)}


@pytest.mark.parametrize("page", PAGES)
def test_every_block_says_what_is_done_with_it(page: str):
    for block in fences(page):
        assert block.language in RUN | SHOWN or "file" in block.options or "not-run" in block.options, str(block)
        assert block.options.keys() <= OPTIONS, str(block)
        if block.language == "console":
            assert block.commands, f"{block}: no line begins with `$ `."
        if "not-run" in block.options:
            assert len(block.options["not-run"].split()) >= 3, f"{block} does not say why it is not run."


def test_pages_with_a_test_of_their_own_are_read_by_it():
    for page, test in OWN_TESTS.items():
        assert Path(page).name in (ROOT / test).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_to_a_file_and_a_heading_that_are_there(page: str):
    # Between two backticks stands a sentence of a command, where brackets are no link.
    for match in LINK.finditer(re.sub(r"``.*?``", "", prose(page))):
        target, _, anchor = match["target"].partition("#")
        if "://" in target or target.startswith("mailto:"):
            continue
        path = (ROOT / page).parent / target if target else ROOT / page
        if path.parent.name == "reference" and path.name in MADE_WITH_THE_SITE:
            continue
        assert path.exists(), f"{page}: {match['target']} is not there."
        if anchor and path.suffix == ".md":
            assert anchor in anchors(path), f"{page}: {target or page} has no heading #{anchor}."
        if path.suffix == ".py" and re.fullmatch(r"`\w+`", match["text"]):
            assert match["text"].strip("`") in definitions(path), f"{page}: {target} does not define {match['text']}."


def commands_in(page: str) -> list[str]:
    """Commands of a page that are not run as they stand: inline ones, and those of blocks that say why."""
    blocks = [block for block in fences(page) if block.language == "console"]
    return [*INLINE.findall(prose(page)), *(command for block in blocks for command in block.commands)]


@pytest.mark.parametrize("page", PAGES)
def test_every_command_in_the_text_exists_with_its_options(page: str):
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.M))
    for command in commands_in(page):
        program, name, *words = [*words_of(command), ""]
        if program == "make" and name and "=" not in name:
            assert name in targets, f"{page}: `{command}` is no target of the Makefile."
        if program != "duralab" or not re.fullmatch(r"[a-z][a-z-]*", name):
            continue
        assert name in PROGRAM.list_commands(None), f"{page}: `{command}` is no command."
        found = PROGRAM.commands[name]
        if words[0] in getattr(found, "commands", ()):
            found = found.commands[words[0]]
        known = {option for parameter in found.params for option in parameter.opts} | {"--help"}
        used = {word.strip("[]").partition("=")[0] for word in words if word.strip("[").startswith("--")}
        assert used <= known, f"{page}: `{command}` has options that are not known: {used - known}."


def test_a_block_is_read_with_what_is_told_about_it():
    blocks = fences("docs/guides/own-specimen.md")
    assert {block.options.get("file") for block in blocks} >= {"quarter_car.sdf", "try.py"}
    folded = Fence(page="", line=1, language="console", text="$ duralab run \\\n  a.yaml\ndone\n")
    assert [command.split() for command in folded.commands] == [["duralab", "run", "a.yaml"]]
