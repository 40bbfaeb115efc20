"""Only regular files are read: what would make its reader wait for ever is refused before it is opened."""

import os
import socket
from pathlib import Path

import pytest

from duralab_settings import open_regular, read_regular, require_regular


def test_a_regular_file_is_read_also_over_a_link(tmp_path):
    path, link = tmp_path / "a", tmp_path / "link"
    path.write_bytes(b"abc")
    link.symlink_to(path)
    for place in (path, link):
        assert require_regular(place).st_size == 3
        assert read_regular(place, largest=3) == b"abc"
        with open_regular(place) as stream:
            assert (stream.read(1), stream.seek(0), stream.read()) == (b"a", 0, b"abc")
    with pytest.raises(OSError, match="it has 3 bytes, and 2 are allowed"):
        read_regular(path, largest=2)


def test_what_is_no_regular_file_is_named_at_once(tmp_path, monkeypatch):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    # A path of a socket may have 108 characters.
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        for path, said in (
            (fifo, "it is a FIFO, and only a regular file is read"),
            (Path("socket"), "it is a socket, and only a regular file is read"),
            (Path(os.devnull), "it is a device, and only a regular file is read"),
        ):
            for read in (require_regular, open_regular, lambda path: read_regular(path, largest=10)):
                with pytest.raises(OSError, match=said) as caught:
                    read(path)
                assert caught.value.strerror == said
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "none")
    with pytest.raises(ValueError, match="null"):
        open_regular(Path("a\0b"))


def test_a_name_that_becomes_a_fifo_while_it_is_opened_makes_nobody_wait(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.touch()
    opened = os.open

    def late(place, flags, *mode):
        path.unlink()
        os.mkfifo(path)
        return opened(place, flags, *mode)

    monkeypatch.setattr(os, "open", late)
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(OSError, match="it is a FIFO"):
        open_regular(path)
    assert len(list(Path("/proc/self/fd").iterdir())) == before
