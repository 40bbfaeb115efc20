"""Pages of the notebooks, with the outputs and pictures that are stored in them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

NOTEBOOKS: Final = "tutorials/notebooks"
"""Folder of the notebooks in `docs`; its pages are at its position in `nav`."""


def notebook_pages(docs: Path) -> dict[str, str | bytes]:
    """Return Markdown of each notebook, and its pictures, by name in the site.

    Parameters
    ----------
    docs : Path
        Folder of the documentation.

    Returns
    -------
    dict
        Text of the pages and bytes of the pictures.
    """
    from nbconvert import MarkdownExporter

    found: dict[str, str | bytes] = {}
    for path in sorted((docs / NOTEBOOKS).glob("*.ipynb")):
        text, resources = MarkdownExporter().from_filename(str(path), resources={"output_files_dir": path.stem})
        title, _, rest = text.lstrip().partition("\n")
        download = f"Download this [notebook]({path.name}); the outputs are those of its last run.\n"
        found[f"{NOTEBOOKS}/{path.stem}.md"] = f"{title}\n\n{download}{rest}"
        found |= {f"{NOTEBOOKS}/{name}": picture for name, picture in resources["outputs"].items()}
    return found
