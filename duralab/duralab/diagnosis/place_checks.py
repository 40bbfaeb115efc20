"""Whether there is room, whether what must be written can be, and whether a terminal can show it."""

from __future__ import annotations

import codecs
import os
import tempfile
from pathlib import Path
from typing import Final

from duralab.diagnosis.finding import Finding, fine, problem, warning

MEBIBYTE: Final = 1024 * 1024

RECORDER_KEEPS_FREE: Final = 256 * MEBIBYTE
"""The recorder waits below this, so that the system still has room."""

COMFORTABLE: Final = 2048 * MEBIBYTE
"""Seventeen times what the shipped demo leaves, 118 MiB."""

TEMPORARY_NEEDS: Final = 64 * MEBIBYTE
"""The services' settings, and the live view that is made again from a log."""


def check_disk(folder: Path, *, free: int) -> Finding:
    """Judge the room on a disk."""
    sentence = f"{free / MEBIBYTE:,.0f} MiB are free for recordings in {folder}"
    if free < RECORDER_KEEPS_FREE:
        return problem(
            "disk",
            f"Only {sentence}; the recorder keeps {RECORDER_KEEPS_FREE // MEBIBYTE} MiB free and waits below that.",
            "Make room, or give another disk with `duralab up --recordings DIR`.",
        )
    if free < COMFORTABLE:
        return warning("disk", f"Only {sentence}.", "Make room before a long campaign, or give --recordings.")
    return fine("disk", sentence)


def check_writable(check: str, folder: Path, *, remedy: str) -> Finding:
    """Judge whether a file can be made in a folder, or in the nearest one above it that is there."""
    place = nearest_folder(folder)
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        return problem(check, f"Nothing can be written in {place}: {error.strerror}.", remedy)
    return fine(check, f"{folder} can be written")


def check_temporary(folder: Path, *, free: int) -> Finding:
    """Judge the folder for temporary files, with the bytes free there."""
    written = check_writable("temporary", folder, remedy="Set TMPDIR to a folder that you may write.")
    if written.remedy:
        return written
    if free < TEMPORARY_NEEDS:
        return problem(
            "temporary",
            f"Only {free / MEBIBYTE:,.0f} MiB are free in {folder}; {TEMPORARY_NEEDS // MEBIBYTE} MiB are needed.",
            "Make room there, or set TMPDIR to a folder on another disk.",
        )
    return fine("temporary", f"{folder}, {free / MEBIBYTE:,.0f} MiB free")


def check_locale(encoding: str, *, file_names: str) -> Finding:
    """Judge how text is written."""
    wrong = [name for name in (encoding, file_names) if not _is_utf_8(name)]
    if wrong:
        return warning(
            "locale",
            f"Text is written as {', '.join(dict.fromkeys(wrong))}; some characters will be shown as question marks.",
            "Set LC_ALL to a locale of UTF-8, e.g. C.UTF-8, or set PYTHONUTF8=1.",
        )
    return fine("locale", "UTF-8")


def _is_utf_8(name: str) -> bool:
    try:
        return codecs.lookup(name).name == "utf-8"
    except LookupError:
        return False


def nearest_folder(folder: Path) -> Path:
    """Return a folder, or the nearest one above it that is there."""
    place = folder.absolute()
    while not place.is_dir() and place != place.parent:
        place = place.parent
    return place


def free_bytes(folder: Path) -> int:
    """Return the bytes free for this user on the disk of a folder that need not be there yet."""
    import shutil

    return shutil.disk_usage(os.fspath(nearest_folder(folder))).free
