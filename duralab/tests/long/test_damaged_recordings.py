"""A file that is cut is read up to its last whole record; one whose index is damaged is refused, never shortened."""

import re
import struct
from contextlib import suppress

import pytest
import synthetic_campaign
from mcap.exceptions import EndOfFile
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from test_cli import invoke

import duralab
from duralab.errors import InputError
from duralab_proto.v1 import iterator_pb2
from duralab_recordings.damage import damaged

STEPS = 3
FOOTER_AND_MAGIC = 9 + 20 + 8


def steps(count):
    return [iterator_pb2.IterationStep(iteration=number, run=f"i{number}ä") for number in range(1, count + 1)]


def numbers_of(path):
    return [step.iteration for step in duralab.open(path).messages(iterator_pb2.IterationStep)]


@pytest.fixture(scope="module", params=[CompressionType.NONE, CompressionType.LZ4])
def written(request, tmp_path_factory):
    """Return a small recording's bytes, and how many of its steps lie whole before each position."""
    path = tmp_path_factory.mktemp("small") / "r.mcap"
    ends = []
    with path.open("wb") as stream:
        writer = Writer(stream, compression=request.param, enable_data_crcs=True)
        writer.start(profile="duralab")
        writer.add_metadata("part", {"recording": "demö", "number": "1"})
        schema = writer.register_schema(iterator_pb2.IterationStep.DESCRIPTOR.full_name, "protobuf", b"")
        channel = writer.register_channel("step/IterationStep", "protobuf", schema, {"epoch": "1"})
        for number, step in enumerate(steps(STEPS)):
            writer.add_message(channel, log_time=number, publish_time=number, data=step.SerializeToString())
            before = stream.tell()
            writer.flush()
            stream.flush()
            ends.append(chunk_end(path.read_bytes(), before))
            writer.add_attachment(0, 0, f"drive/{number}", "text/plain", b"abc")
        writer.add_metadata("summary", {"recording": "demö", "next_file": ""})
        writer.finish()
    content = path.read_bytes()
    return content, [sum(end <= position for end in ends) for position in range(len(content) + 1)]


def chunk_end(content, start):
    """Return the end of the first chunk at or after a position: its opcode is 6, its length the eight bytes after."""
    while content[start] != 6:
        start += 9 + int.from_bytes(content[start + 1 : start + 9], "little")
    return start + 9 + int.from_bytes(content[start + 1 : start + 9], "little")


def test_a_recording_cut_anywhere_holds_the_steps_that_lie_whole_before_the_cut(written, tmp_path):
    content, whole_before = written
    assert whole_before[-1] == STEPS
    path = tmp_path / "cut.mcap"
    head = 8 + 9 + int.from_bytes(content[9:17], "little")
    for position in range(head):
        path.write_bytes(content[:position])
        with pytest.raises(InputError, match=r"holds nothing|is no recording"):
            duralab.open(path)
    for position in range(head, len(content) + 1):
        path.write_bytes(content[:position])
        recording = duralab.open(path)
        found = [step.iteration for step in recording.messages(iterator_pb2.IterationStep)]
        assert found == list(range(1, whole_before[position] + 1)), position
        assert recording.whole == (position == len(content))
        assert recording.metadata.get("part", {}).get("recording", "demö") == "demö"


def test_a_flipped_bit_in_the_index_or_the_footer_is_damage(written, tmp_path):
    """Wherever it is: each bit of the index belongs to a chunk, a channel or a schema that would be missing."""
    content, _ = written
    start = int.from_bytes(content[-FOOTER_AND_MAGIC + 9 : -FOOTER_AND_MAGIC + 17], "little")
    path = tmp_path / "flipped.mcap"
    for position in range(start, len(content)):
        flipped = bytearray(content)
        flipped[position] ^= 1 << position % 8
        path.write_bytes(flipped)
        with pytest.raises(InputError, match=r"is damaged \([a-z].*\); `duralab verify .*flipped\.mcap` says where\.$"):
            duralab.open(path)


def test_a_finished_file_with_a_damaged_footer_is_not_called_unfinished(written, tmp_path):
    content, _ = written
    path = tmp_path / "flipped.mcap"
    path.write_bytes(content[:-20] + bytes([content[-20] ^ 4]) + content[-19:])
    with pytest.raises(InputError, match="is damaged"):
        duralab.open(path).responses("demo.i01")


def test_an_index_without_a_checksum_is_taken_as_it_is(tmp_path):
    """The format allows writers not to work one out."""
    path = tmp_path / "r.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, enable_crcs=False)
        writer.start()
        schema = writer.register_schema(iterator_pb2.IterationStep.DESCRIPTOR.full_name, "protobuf", b"")
        channel = writer.register_channel("step/IterationStep", "protobuf", schema)
        writer.add_message(channel, log_time=0, publish_time=0, data=steps(1)[0].SerializeToString())
        writer.finish()
    assert numbers_of(path) == [1]
    assert duralab.open(path).whole


@pytest.mark.parametrize("size", [8, 9, 16, 36, 37, 44, 45])
def test_a_file_of_hardly_more_than_its_mark_holds_nothing(tmp_path, size):
    path = tmp_path / "r.mcap"
    path.write_bytes((b"\x89MCAP0\r\n" + b"\x01" + (100).to_bytes(8, "little")).ljust(size, b"a")[:size])
    with pytest.raises(InputError, match=r"holds nothing; give a recording\.mcap"):
        duralab.open(path)


def test_damage_within_an_unfinished_file_is_no_end(tmp_path):
    path = synthetic_campaign.write(tmp_path / "r.mcap", steps(200), finish=False, chunk_size=500)
    content = bytearray(path.read_bytes())
    assert numbers_of(path) == list(range(1, 201))
    with path.open("rb") as stream:
        chunks = []
        # It has no end.
        with suppress(EndOfFile):
            chunks.extend(
                record for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk)
            )
    stored = chunks[len(chunks) // 2].data
    content[content.index(stored) + len(stored) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(InputError, match="is damaged"):
        numbers_of(path)


@pytest.mark.parametrize("name", ["", ".", "/", "..", "\0", "a" * 300, "a" * 250 + ".mcap", "there/none.mcap"])
def test_a_name_that_is_no_recording_is_refused_in_one_sentence(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"^[^\n]*; give the path of an \.mcap file\.$"):
        duralab.open(name)


def test_a_name_as_long_as_a_name_may_be_is_opened(tmp_path):
    path = synthetic_campaign.write(tmp_path / ("a" * 250 + ".mcap"), steps(2))
    assert numbers_of(path) == [1, 2]


@pytest.mark.parametrize(
    "command",
    [("report", "."), ("report", ""), ("export", "", "o.csv"), ("compare", "/", "x.mcap"), ("report", "a" * 300)],
)
def test_the_commands_say_so_too(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    code, _, error = invoke(*command)
    assert code == 2
    assert "give the path of an .mcap file." in " ".join(error.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "error", [KeyError(11), EndOfFile(), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "no"), ValueError(), struct.error()]
)
def test_every_damage_has_a_reason_in_words(tmp_path, error):
    reason = re.search(r"is damaged \((.*)\);", str(damaged(tmp_path, error)))[1]
    assert len(reason) > 5
    assert not reason.isdigit()


def test_verify_reads_a_file_without_a_lab(tmp_path, written):
    content, _ = written
    path = tmp_path / "recording.mcap"
    path.write_bytes(content)
    code, stdout, _ = invoke("verify", path)
    assert code == 1
    # It is no recorder's own.
    assert "an entry 'reason' is missing in it" in " ".join(stdout.split())
    assert f"{path} is not whole." in stdout
    code, _, stderr = invoke("verify", tmp_path / "other.mcap")
    assert code == 2
    assert "There is no file" in stderr
