"""Check pages, help texts, settings, error sentences and docstrings of faces against plain_english.yaml.

`python scripts/plain_english.py [--rule NAME] [PATH ...]` prints each finding and ends with 1 if there is any.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
RULES = Path(__file__).with_suffix(".yaml")
PUBLIC_FOLDERS = tuple(f"duralab/duralab/{folder}/" for folder in ("formats", "target", "testing"))
"""Folders inside a package that users import from."""

SETTINGS = ("Section", "BaseModel", "BaseSettings")
HELP = ("help", "description", "epilog", "short_help")
SAID = ("say", "warn", "echo")
"""Methods that print a sentence for people."""

_LITERAL = re.compile(
    r"^(?P<fence>`{3,}|~{3,}).*?^(?P=fence)[`~]*$|`[^`\n]*`|\]\([^)\s]*\)|<!--.*?-->|\$\$.*?\$\$", flags=re.M | re.S
)


@dataclass(frozen=True)
class Rule:
    """A wording that is not plain English, why, and what to write."""

    name: str
    pattern: re.Pattern[str]
    write: str


@dataclass(frozen=True)
class Text:
    """A text that users read: its file, the line that it begins on, and its kind."""

    path: str
    line: int
    kind: str
    content: str


def load_rules(path: Path = RULES) -> list[Rule]:
    """Return the rules; a pattern matches whole words, in any case, also over the end of a line."""
    rules = []
    for name, rule in yaml.safe_load(path.read_text(encoding="utf-8")).items():
        pattern = re.compile(rf"(?<![\w-])(?:{rule['pattern']})(?![\w-])", flags=re.I)
        rules.append(Rule(name=name, pattern=pattern, write=rule["write"]))
    return rules


def findings(text: Text, rules: list[Rule]) -> Iterator[tuple[int, str, Rule]]:
    """Yield the line, the wording and the rule of each finding in a text; code and links are skipped."""
    plain = _LITERAL.sub(lambda match: re.sub(r"[^\n]", "\0", match[0]), text.content)
    for rule in rules:
        for match in rule.pattern.finditer(re.sub(r"\n *", lambda gap: " " * len(gap[0]), plain)):
            yield text.line + text.content.count("\n", 0, match.start()), " ".join(match[0].split()), rule


def page_texts(path: str) -> Iterator[Text]:
    """Yield the text of a page."""
    yield Text(path, 1, "page", (ROOT / path).read_text(encoding="utf-8"))


def python_texts(path: str, exported: set[str]) -> Iterator[Text]:
    """Yield the user-visible texts of a module: help, settings, error sentences, and docstrings of exported names."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    commands = "/cli/commands/" in path
    if path.endswith("__init__.py") and exported:
        yield from _docstring(path, tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg in HELP and (content := _string(node.value)):
            yield Text(path, node.value.lineno, "help", content)
        elif isinstance(node, ast.Raise) and node.exc is not None:
            yield from _sentences(path, node.exc, "error")
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") in SAID:
            yield from _sentences(path, node, "message")
        elif isinstance(node, ast.ClassDef):
            bases = {ast.unparse(base) for base in node.bases}
            if node.name in exported or bases & set(SETTINGS):
                yield from _class(path, node)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and (node.name in exported or commands):
            yield from _docstring(path, node)


def _sentences(path: str, node: ast.expr, kind: str) -> Iterator[Text]:
    """Yield the strings with several words in an expression."""
    inside = {id(part) for joined in ast.walk(node) if isinstance(joined, ast.JoinedStr) for part in joined.values}
    for one in ast.walk(node):
        if isinstance(one, ast.expr) and id(one) not in inside and " " in (content := _string(one)):
            yield Text(path, one.lineno, kind, content)


def _class(path: str, node: ast.ClassDef) -> Iterator[Text]:
    yield from _docstring(path, node)
    for item in node.body:
        if isinstance(item, ast.Expr) and item is not node.body[0] and (content := _string(item.value)):
            yield Text(path, item.lineno, "setting", content)
        if isinstance(item, ast.FunctionDef | ast.AsyncFunctionDef) and not item.name.startswith("_"):
            yield from _docstring(path, item)


def _docstring(path: str, node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[Text]:
    if ast.get_docstring(node) is not None:
        first = node.body[0]
        assert isinstance(first, ast.Expr)
        yield Text(path, first.lineno, "docstring", _string(first.value))


def _string(node: ast.expr) -> str:
    """Return a string as written, an f-string with a gap for each value, and nothing for other expressions."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
    return ""


def tracked() -> list[str]:
    """Return the files of the repository."""
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, check=True)
    return sorted(name for name in set(listed.stdout.decode().splitlines()) if (ROOT / name).is_file())


def faces(modules: list[str]) -> dict[str, set[str]]:
    """Return the exported names of each package's top face and of the folders that users import from, by folder."""
    found = {}
    for path in modules:
        folder = path.removesuffix("__init__.py")
        is_top = path != folder and not (ROOT / folder).parent.joinpath("__init__.py").is_file()
        if not is_top and folder not in PUBLIC_FOLDERS:
            continue
        for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
                found[folder] = set(ast.literal_eval(node.value))
    return found


def texts() -> Iterator[Text]:
    """Yield all texts that users read."""
    names = tracked()
    for name in names:
        if name.endswith("README.md") or (name.startswith("docs/") and name.endswith(".md")):
            yield from page_texts(name)
    own = [name for name in names if name.endswith(".py") and not re.search(r"_pb2|(^|/)(tests|examples)/", name)]
    exported = faces(own)
    for name in own:
        yield from python_texts(
            name, {one for folder, all_ in exported.items() if name.startswith(folder) for one in all_}
        )


def main() -> None:
    """Print the findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", help="files or folders to check; all if none is given")
    parser.add_argument("--rule", help="name of the only rule to check")
    asked = parser.parse_args()
    rules = [rule for rule in load_rules() if asked.rule in (None, rule.name)]
    count = 0
    for text in texts():
        if asked.paths and not text.path.startswith(tuple(asked.paths)):
            continue
        for line, wording, rule in findings(text, rules):
            count += 1
            sys.stdout.write(f"{text.path}:{line}: {text.kind}: {wording!r} ({rule.name}): {rule.write}\n")
    if count:
        sys.exit(f"{count} findings of plain English; the rules are in {RULES.relative_to(ROOT)}.")


if __name__ == "__main__":
    main()
