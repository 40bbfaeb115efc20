"""MkDocs hooks of this site: pages made from code, links into the repository, equations as MathML."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from campaign_file_page import campaign_file_page
from commands_page import commands_page
from equations import with_equations
from fences import with_titles
from messages_page import messages_page
from mkdocs.structure.files import File, Files, InclusionLevel
from notebook_pages import notebook_pages
from python_page import python_page
from source_pages import SourcePages

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
GENERATED = {
    "reference/python.md": python_page,
    "reference/commands.md": commands_page,
    "reference/campaign-file.md": campaign_file_page,
    "reference/messages.md": messages_page,
}
SOURCES = SourcePages(ROOT)


def on_config(config: MkDocsConfig) -> None:
    """Replace a folder in `nav` by its pages, except those that `nav` names elsewhere."""
    docs = Path(config.docs_dir)
    named = _pages_named(config.nav)

    def opened(entry: Any) -> list[Any]:
        if isinstance(entry, dict):
            ((title, value),) = entry.items()
            if isinstance(value, str):
                return [{title: _pages_in(docs, value, named)}] if value.endswith("/") else [entry]
            return [{title: [page for item in value for page in opened(item)]}]
        return _pages_in(docs, entry, named) if entry.endswith("/") else [entry]

    config.nav = [page for entry in config.nav or [] for page in opened(entry)]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from code, and one for each file of the repository that a page links to."""
    for name, page in GENERATED.items():
        files.append(File.generated(config, name, content=page()))
    for name, content in notebook_pages(Path(config.docs_dir)).items():
        files.append(File.generated(config, name, content=content))
    written = {file.src_uri: Path(file.abs_src_path).read_text(encoding="utf-8") for file in _own_pages(files)}
    for name, content in SOURCES.pages_for(written).items():
        files.append(File.generated(config, name, content=content, inclusion=InclusionLevel.NOT_IN_NAV))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Convert links into the repository to links to its source pages, and options of fences to titles."""
    return with_titles(SOURCES.with_links(markdown, page.file.src_uri))


def on_page_content(html: str, **_: Any) -> str:
    """Write equations as MathML, which browsers draw without a script."""
    return with_equations(html)


def _own_pages(files: Files) -> list[File]:
    return [file for file in files.documentation_pages() if file.generated_by is None]


def _pages_in(docs: Path, folder: str, named: set[str]) -> list[str]:
    found = sorted(path.relative_to(docs).as_posix() for path in (docs / folder).glob("*.md"))
    index = [name for name in found if name.endswith("README.md")]
    return [name for name in index + [name for name in found if name not in index] if name not in named]


def _pages_named(entry: Any) -> set[str]:
    if isinstance(entry, str):
        return {entry}
    values = entry.values() if isinstance(entry, dict) else entry or []
    return set().union(*(_pages_named(value) for value in values))
