"""Part of a page that a script writes: the text between two markers."""

from __future__ import annotations

from pathlib import Path

END = "<!-- end of numbers -->"


def between_markers(text: str, numbers: str, *, script: Path) -> str:
    """Return a page with the text between a script's markers replaced.

    Raises
    ------
    ValueError
        Where the page does not have both markers once.
    """
    begin = f"<!-- numbers: studies/{script.name} -->"
    if text.count(begin) != 1 or text.count(END) != 1:
        raise ValueError(
            f"The page has {begin!r} {text.count(begin)} times and {END!r} {text.count(END)} times; "
            "put both in once, where the numbers go."
        )
    before, _, rest = text.partition(begin)
    after = rest.partition(END)[2]
    return f"{before}{begin}\n\n{numbers.strip()}\n\n{END}{after}"


def write_numbers(page: Path, numbers: str, *, script: Path) -> None:
    """Replace the text between a script's markers in a page.

    Raises
    ------
    ValueError
        Where the page does not have both markers once.
    """
    page.write_text(between_markers(page.read_text(encoding="utf-8"), numbers, script=script), encoding="utf-8")
