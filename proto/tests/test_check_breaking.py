"""The breaking check: additions pass, everything that breaks a reader is named."""

import importlib.util
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "check_breaking.py"
_spec = importlib.util.spec_from_file_location("check_breaking", SCRIPT)
assert _spec is not None
assert _spec.loader is not None
check_breaking = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(check_breaking)

LANDED = """
syntax = "proto3";
package duralab.v1;
enum Mode { MODE_UNSPECIFIED = 0; MODE_IDLE = 1; reserved 7; reserved "MODE_OLD"; }
message Inner { double value = 1; }
message Rig {
  reserved 8, 9;
  reserved "gone";
  string name = 1;
  Inner inner = 2;
  repeated double gains = 3;
  Mode mode = 4;
  oneof choice { string text = 5; uint64 number = 6; }
  enum Nested { NESTED_UNSPECIFIED = 0; NESTED_ONE = 1; }
}
"""


def git(folder, *arguments):
    identity = ["-c", "user.name=Test", "-c", "user.email=test@example.invalid", "-c", "commit.gpgsign=false"]
    hooks = ["-c", "core.hooksPath=/dev/null"]
    subprocess.run(["git", *identity, *hooks, *arguments], cwd=folder, check=True, capture_output=True)


@pytest.fixture(scope="module")
def landed(tmp_path_factory):
    root = tmp_path_factory.mktemp("repository") / "proto"
    file = root / "duralab" / "v1" / "rig.proto"
    file.parent.mkdir(parents=True)
    file.write_text(LANDED)
    git(root, "init", "-q")
    git(root, "add", ".")
    git(root, "commit", "-q", "-m", "landed")
    return file


@pytest.fixture
def check(landed, capfd):
    def run(*edits):
        text = LANDED
        for old, new in edits:
            assert old in text
            text = text.replace(old, new)
        landed.write_text(text)
        status = check_breaking.main(["--root", str(landed.parents[2])])
        return status, capfd.readouterr().err

    return run


@pytest.mark.parametrize(
    "edit",
    [
        ("string name = 1;", "string name = 1;\n  string more = 10;"),
        ("message Inner", "message Another { string text = 1; }\nmessage Inner"),
        ("MODE_IDLE = 1;", "MODE_IDLE = 1; MODE_PLAYING = 2;"),
        ("string name = 1;", "// Said better.\n  string name = 1;"),
        ("reserved 8, 9;", "reserved 8 to 20;"),
    ],
    ids=["field", "message", "enum value", "comment", "more reserved"],
)
def test_addition_passes(check, edit):
    assert check(edit) == (0, "")


def test_field_may_go_when_number_and_name_are_reserved(check):
    edits = [("reserved 8, 9;", "reserved 3, 8, 9;"), ('reserved "gone";', 'reserved "gone", "gains";')]
    assert check(("repeated double gains = 3;", ""), *edits) == (0, "")
    for edit in edits:
        status, said = check(("repeated double gains = 3;", ""), edit)
        assert status == 1
        assert "duralab.v1.Rig.gains = 3 is gone" in said


def test_field_may_be_renamed_when_its_old_name_is_reserved(check):
    reserved = ('reserved "gone";', 'reserved "gone", "name";')
    assert check(("string name = 1;", "string title = 1;"), reserved) == (0, "")
    status, said = check(("string name = 1;", "bytes title = 1;"), reserved)
    assert status == 1
    assert "was optional string and is optional bytes" in said


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (("string name = 1;", ""), "Rig.name = 1 is gone"),
        (("string name = 1;", "string name = 10;"), "Rig.name = 1 has become number 10"),
        (("string name = 1;", "string title = 1;"), "Rig.name = 1 is now called title; reserve its old name"),
        (("string name = 1;", "bytes name = 1;"), "was optional string and is optional bytes"),
        (("string name = 1;", "optional string name = 1;"), "is optional string with presence"),
        (("repeated double gains", "double gains"), "was repeated double and is optional double"),
        (("Inner inner = 2;", "Mode inner = 2;"), "was optional duralab.v1.Inner and is optional duralab.v1.Mode"),
        (("string text = 5; uint64", "uint64"), "Rig.text = 5 is gone"),
        (("oneof choice { string text = 5;", "string text = 5; oneof choice {"), "was optional string in oneof choice"),
        (("message Inner { double value = 1; }", "message Inner {}"), "Inner.value = 1 is gone"),
        (("NESTED_ONE = 1;", ""), "Rig.Nested.NESTED_ONE = 1 is gone"),
        (("MODE_IDLE = 1;", "MODE_IDLE = 2;"), "Mode.MODE_IDLE = 1 has become 2"),
        (("MODE_IDLE = 1;", "MODE_RESTING = 1;"), "Mode.MODE_IDLE = 1 is gone"),
        (("reserved 8, 9;", "reserved 8;"), "no longer reserves the numbers 9 to 9"),
        (('reserved "gone";', ""), "no longer reserves the name 'gone'"),
        (("reserved 7;", ""), "Mode no longer reserves the numbers 7 to 7"),
        (("package duralab.v1;", "package duralab.v2;"), "The message duralab.v1.Rig is gone"),
        (("string name = 1;", "string name = ;"), "does not compile"),
    ],
)
def test_break_is_named(check, edit, said):
    status, message = check(edit)
    assert status == 1
    assert said in message


def test_message_that_moves_to_another_file_is_still_there(check, landed):
    other = landed.with_name("inner.proto")
    other.write_text('syntax = "proto3";\npackage duralab.v1;\nmessage Inner { double value = 1; }\n')
    try:
        assert check(
            ("message Inner { double value = 1; }", ""),
            ("package duralab.v1;", 'package duralab.v1;\nimport "duralab/v1/inner.proto";'),
        ) == (0, "")
    finally:
        other.unlink()


def test_nothing_to_compare_with_is_said_and_passes(landed, tmp_path, monkeypatch, capfd):
    landed.write_text(LANDED)
    assert check_breaking.main(["--root", str(landed.parents[2]), "--base", "no-such-revision"]) == 0
    assert "nothing to compare" in capfd.readouterr().err
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert check_breaking.main(["--root", str(tmp_path)]) == 0
    assert "nothing to compare" in capfd.readouterr().err
    monkeypatch.setenv("PATH", str(tmp_path))
    assert check_breaking.main(["--root", str(landed.parents[2])]) == 0
    assert "nothing to compare" in capfd.readouterr().err
