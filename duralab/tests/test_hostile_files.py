"""Files that would keep their reader waiting or fill its memory: refused, or read, at once."""

import os
import signal
import tracemalloc

import pytest
import synthetic_campaign
from test_cli import invoke

import duralab
from duralab.campaign import load_campaign, load_identification, load_import_settings, parse_campaign
from duralab.errors import InputError
from duralab.formats import Format, read_frequency_response, read_signals
from duralab.security.certificates import load_certificate
from duralab_bus import BusConfig, ConfigError, load_config
from duralab_proto.v1 import iterator_pb2, rig_pb2

GIBIBYTE = 2**30
PATIENCE_SECONDS = 60
BOMB = "\n".join(
    ["l0: &l0 [x]", *(f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 9)}]" for n in range(1, 11)), "name: *l10"]
)


@pytest.fixture(autouse=True)
def deadline():
    """Fail, where the code of before would hang."""

    def give_up(*_):
        raise AssertionError(f"no answer after {PATIENCE_SECONDS} s")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(PATIENCE_SECONDS)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def fifo(tmp_path):
    path = tmp_path / "fifo.mcap"
    os.mkfifo(path)
    return path


@pytest.mark.parametrize(
    "read",
    [
        duralab.open,
        *(lambda path, form=form: read_signals(path, format=form) for form in Format),
        read_frequency_response,
        load_certificate,
        load_campaign,
        load_identification,
        load_import_settings,
        lambda path: load_config(BusConfig, path),
    ],
)
def test_a_fifo_is_refused_by_every_reader(fifo, read):
    with pytest.raises((InputError, ConfigError)) as caught:
        read(fifo)
    assert "FIFO" in str(caught.value) or "There is no campaign file" in str(caught.value)


@pytest.mark.parametrize(
    "words", [("verify",), ("report",), ("export", "{out}/a.csv"), ("view",), ("convert", "{out}/a.csv")]
)
def test_a_fifo_is_refused_by_every_command(fifo, tmp_path, words):
    command, *rest = (word.format(out=tmp_path) for word in words)
    if command == "convert":
        fifo = fifo.rename(tmp_path / "fifo.csv")
    code, _, err = invoke(command, fifo, *rest)
    assert (code, "FIFO" in err) == (2, True), err


def open_and_read(path):
    recording = duralab.open(path)
    kinds = (iterator_pb2.IterationStep, rig_pb2.SignalBlock)
    return recording.metadata, [sum(1 for _ in recording.messages(kind)) for kind in kinds]


def test_gibibytes_of_zeros_behind_a_recording_that_was_killed_are_no_part_of_it(tmp_path):
    steps = synthetic_campaign.steps(synthetic_campaign.make(seconds=2.0))
    path = synthetic_campaign.write(tmp_path / "killed.mcap", steps, finish=False)
    size, whole = path.stat().st_size, open_and_read(path)
    os.truncate(path, 3 * GIBIBYTE)
    tracemalloc.start()
    try:
        assert open_and_read(path) == whole
        assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    finally:
        tracemalloc.stop()
    with path.open("r+b") as stream:
        stream.seek(GIBIBYTE)
        stream.write(b"\x06")
    with pytest.raises(InputError, match=f"at byte {size} are zeros where a record was to come, and other bytes"):
        duralab.open(path)


def test_zeros_in_the_place_of_a_chunk_are_damage_and_no_empty_chunk(tmp_path):
    steps = synthetic_campaign.steps(synthetic_campaign.make(seconds=2.0))
    path = synthetic_campaign.write(tmp_path / "r.mcap", steps, chunk_size=4096, part=("demo", 1))
    content = path.read_bytes()
    position, places = 8, {}
    while content[position] != 0x0F:
        length = 9 + int.from_bytes(content[position + 1 : position + 9], "little")
        places.setdefault(content[position], []).append(slice(position, position + length))
        position += length
    for kind, number in ((0x06, len(places[0x06]) // 2), (0x0C, 0)):
        place = places[kind][number]
        path.write_bytes(content[: place.start] + bytes(place.stop - place.start) + content[place.stop :])
        with pytest.raises(InputError, match=rf"is damaged \(at byte {place.start} is not the "):
            open_and_read(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BOMB, "it holds more than 100000 values"),
        ("#" * (50 * 2**20), "52428800 .*1048576 are allowed"),
        ("{" + ", ".join(f"k{number}: 1" for number in range(4_000)) + "}", "more are wrong"),
        (f"? {'k' * 10**6}\n: 1", r"unknown key 'k+…"),
        (f"rig: {'x' * 10**6}", r"rig is 'x+…"),
    ],
)
def test_a_hostile_text_of_settings_is_refused_in_a_short_sentence(tmp_path, text, said):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    for read in (
        load_campaign,
        load_identification,
        load_import_settings,
        lambda path: load_config(BusConfig, path),
        lambda path: parse_campaign(text, name=str(path)),
    ):
        with pytest.raises((InputError, ConfigError)) as caught:
            read(path)
        assert len(str(caught.value)) < 8000
    with pytest.raises(InputError, match=said):
        load_campaign(path)
