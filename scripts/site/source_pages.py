"""Pages for the files of the repository that the documentation links to, so that no link leads out of the site."""

from __future__ import annotations

import ast
import posixpath
import re
from pathlib import Path, PurePosixPath

_LINK = re.compile(r"(?P<image>!?)(\[(?P<text>[^\]]*)\]\()(?P<target>[^)\s#]+)(?P<anchor>#[^)\s]+)?\)")
_FENCED = re.compile(r"^(`{3,}|~{3,}).*?^\1`*$", flags=re.M | re.S)
_LANGUAGES = {
    ".py": "python",
    ".yaml": "yaml",
    ".yml": "yaml",
    ".proto": "protobuf",
    ".toml": "toml",
    ".js": "javascript",
}
_LANGUAGES |= {".mjs": "javascript", ".ts": "typescript", ".rs": "rust", ".sh": "bash", ".json": "json"}

FOLDERS = {"proto/duralab/v1": "reference/messages.md"}
"""Folders of the repository that a generated page represents."""


class SourcePages:
    """Mapping of the repository's files to pages of the site.

    Parameters
    ----------
    root : Path
        Folder of the repository.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._file_of: dict[str, str] = {}

    def pages_for(self, written: dict[str, str]) -> dict[str, str]:
        """Return a page for every file that is linked to, directly or from such a page.

        Parameters
        ----------
        written : dict
            Markdown of the pages of `docs`, by name.

        Returns
        -------
        dict
            Markdown of the source pages, by name.
        """
        made: dict[str, str] = {}
        waiting = [(f"docs/{name}", content) for name, content in written.items()]
        while waiting:
            origin, content = waiting.pop()
            for match in _LINK.finditer(_FENCED.sub("", content)):
                path = self._outside(origin, match["target"])
                name = f"source/{path}" + ("" if path.endswith(".md") else ".md")
                if not path or match["image"] or path in FOLDERS or name in made:
                    continue
                made[name] = self._page(path)
                self._file_of[name] = path
                if path.endswith(".md"):
                    waiting.append((path, made[name]))
        return made

    def with_links(self, markdown: str, name: str) -> str:
        """Return a page with the links that lead out of `docs` turned to source pages.

        Parameters
        ----------
        markdown : str
            Markdown of the page.
        name : str
            Name of the page in the site.

        Returns
        -------
        str
            Markdown with links to pages of the site only.
        """
        origin = self._file_of.get(name, f"docs/{name}")

        def turned(match: re.Match[str]) -> str:
            page = self._site_page(origin, match["target"])
            if page is None:
                return match[0]
            anchor = match["anchor"] or self._anchor(origin, match["target"], match["text"])
            return f"{match['image']}{match[2]}{posixpath.relpath(page, posixpath.dirname(name) or '.')}{anchor})"

        pieces, end = [], 0
        for fence in _FENCED.finditer(markdown):
            pieces += [_LINK.sub(turned, markdown[end : fence.start()]), fence[0]]
            end = fence.end()
        return "".join([*pieces, _LINK.sub(turned, markdown[end:])])

    def _resolved(self, origin: str, target: str) -> str:
        if "://" in target or target.startswith(("mailto:", "/")):
            return ""
        path = posixpath.normpath(posixpath.join(posixpath.dirname(origin), target))
        if (self._root / path).is_dir() and path not in FOLDERS:
            path = f"{path}/README.md"
        return path

    def _outside(self, origin: str, target: str) -> str:
        """Return the path of a linked file of the repository that is not a page of `docs`; empty otherwise."""
        path = self._resolved(origin, target)
        exists = path in FOLDERS or (bool(path) and ((self._root / path).is_file() or self._is_listing(path)))
        return path if exists and not path.startswith("docs/") else ""

    def _site_page(self, origin: str, target: str) -> str | None:
        path = self._resolved(origin, target)
        if path.startswith("docs/"):
            return path.removeprefix("docs/") if (self._root / path).is_file() else None
        path = self._outside(origin, target)
        if not path:
            return None
        return FOLDERS.get(path) or f"source/{path}" + ("" if path.endswith(".md") else ".md")

    def _anchor(self, origin: str, target: str, text: str) -> str:
        path, name = self._outside(origin, target), text.strip("`").removesuffix("()")
        return f"#{name}" if path.endswith(".py") and name in _definitions(self._root / path) else ""

    def _is_listing(self, path: str) -> bool:
        """Return whether a path is of a README that does not exist in an existing folder of the repository."""
        whole = self._root / path
        return whole.name == "README.md" and whole.parent.is_dir() and not whole.is_file()

    def _listing(self, path: str) -> str:
        folder = (self._root / path).parent
        shown = [entry for entry in sorted(folder.iterdir()) if entry.suffix in _LANGUAGES or (entry / "src").is_dir()]
        shown += sorted(folder.glob("src/*"))
        links = [f"- [{entry.relative_to(folder)}]({entry.relative_to(folder)})" for entry in shown]
        return "\n".join([f"# {folder.name}", "", f"`{posixpath.dirname(path)}`", "", *links, ""])

    def _page(self, path: str) -> str:
        if self._is_listing(path):
            return self._listing(path)
        content = (self._root / path).read_text(encoding="utf-8")
        if path.endswith(".md"):
            return content
        language = _LANGUAGES.get(PurePosixPath(path).suffix, "text")
        title = f"# {PurePosixPath(path).name}\n\n`{path}`\n"
        if language != "python":
            return f"{title}\n~~~~{language}\n{content}~~~~\n"
        lines, parts, begin = content.splitlines(), [title], 0
        for name, first in [*_definitions(self._root / path).items(), ("", len(lines))]:
            parts.append("\n~~~~python\n" + "\n".join(lines[begin:first]).strip("\n") + "\n~~~~\n")
            if name:
                parts.append(f"\n## `{name}` {{ #{name} }}\n")
            begin = first
        return "".join(parts)


def _definitions(path: Path) -> dict[str, int]:
    """Return the first line, from 0, of each function and class of a file, with its decorators."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return {
        node.name: min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)]) - 1
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, kinds)
    }
