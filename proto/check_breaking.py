"""Compare the contract with the last landed one, and fail on changes that break its clients.

Additions are allowed. Existing messages, fields with their number, name and type, and enum values must stay. A field
or enum value may be removed only if its number and its name are both reserved, so that neither is reused with another
meaning. A field may be renamed if the old name is reserved: on the wire only its number and type count.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from importlib import resources
from pathlib import Path

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    EnumDescriptorProto,
    FieldDescriptorProto,
    FileDescriptorSet,
    OneofDescriptorProto,
)
from grpc_tools import protoc

ROOT = Path(__file__).resolve().parent


class ContractError(Exception):
    """A contract that cannot be compared; the message is one sentence."""


def compile_contract(root: Path) -> FileDescriptorSet:
    """Compile every .proto file under `root/duralab` and return the descriptors."""
    sources = sorted(str(path.relative_to(root)) for path in root.glob("duralab/**/*.proto"))
    well_known = resources.files("grpc_tools") / "_proto"
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "contract.binpb")
        status = protoc.main(["protoc", f"-I{root}", f"-I{well_known}", f"--descriptor_set_out={out}", *sources])
        if status != 0:
            raise ContractError(f"The contract in {root} does not compile; the lines above say why.")
        return FileDescriptorSet.FromString(out.read_bytes())


def landed_contract(root: Path, revision: str, target: Path) -> bool:
    """Write the .proto files of a git revision into `target`; return False if the revision has none."""
    try:
        listing = _git(root, "ls-tree", "-r", "-z", "--name-only", revision, "--", "duralab")
    except (OSError, subprocess.CalledProcessError):
        return False
    names = [name for name in listing.decode().split("\0") if name.endswith(".proto")]
    for name in names:
        path = target / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_git(root, "show", f"{revision}:./{name}"))
    return bool(names)


def _git(root: Path, *arguments: str) -> bytes:
    return subprocess.run(["git", *arguments], cwd=root, check=True, capture_output=True).stdout


def compare(old: FileDescriptorSet, new: FileDescriptorSet) -> list[str]:
    """Return one sentence for each breaking change from `old` to `new`."""
    old_messages, old_enums = _index(old)
    new_messages, new_enums = _index(new)
    findings = []
    for name, message in old_messages.items():
        if name in new_messages:
            findings += _compare_message(name, message, new_messages[name])
        else:
            findings.append(f"The message {name} is gone; bring it back.")
    for name, enum in old_enums.items():
        if name in new_enums:
            findings += _compare_enum(name, enum, new_enums[name])
        else:
            findings.append(f"The enum {name} is gone; bring it back.")
    return findings


def _index(
    contract: FileDescriptorSet,
) -> tuple[dict[str, DescriptorProto], dict[str, EnumDescriptorProto]]:
    """Return all messages and enums, nested ones too, by their full names."""
    messages: dict[str, DescriptorProto] = {}
    enums: dict[str, EnumDescriptorProto] = {}

    def add(scope: str, found: Iterable[DescriptorProto]) -> None:
        for message in found:
            name = f"{scope}.{message.name}"
            messages[name] = message
            enums.update((f"{name}.{enum.name}", enum) for enum in message.enum_type)
            add(name, message.nested_type)

    for file in contract.file:
        add(file.package, file.message_type)
        enums.update((f"{file.package}.{enum.name}", enum) for enum in file.enum_type)
    return messages, enums


def _compare_message(name: str, old: DescriptorProto, new: DescriptorProto) -> list[str]:
    findings = []
    new_by_number = {field.number: field for field in new.field}
    new_by_name = {field.name: field for field in new.field}
    # Message ranges end before `end`.
    reserved = [range(entry.start, entry.end) for entry in new.reserved_range]
    for field in old.field:
        what = f"The field {name}.{field.name} = {field.number}"
        now = new_by_number.get(field.number)
        moved = new_by_name.get(field.name)
        if moved is not None and moved.number != field.number:
            findings.append(f"{what} has become number {moved.number}; numbers never change.")
        elif now is None:
            if not (any(field.number in entry for entry in reserved) and field.name in new.reserved_name):
                findings.append(f"{what} is gone; bring it back, or reserve both its number and its name.")
        elif now.name != field.name and field.name not in new.reserved_name:
            findings.append(f"{what} is now called {now.name}; reserve its old name, so that it never comes back.")
        elif (old_kind := _kind(field, old.oneof_decl)) != (new_kind := _kind(now, new.oneof_decl)):
            findings.append(f"{what} was {old_kind} and is {new_kind}; add a new field instead.")
    old_reserved = [range(entry.start, entry.end) for entry in old.reserved_range]
    findings += _compare_reserved(
        name, old_reserved, reserved, lost_names=set(old.reserved_name) - {*new.reserved_name}
    )
    return findings


def _kind(field: FieldDescriptorProto, oneofs: Sequence[OneofDescriptorProto]) -> str:
    """Return the properties of a field that affect its decoding, as text."""
    label = FieldDescriptorProto.Label.Name(field.label).removeprefix("LABEL_").lower()
    kind = field.type_name.removeprefix(".") or FieldDescriptorProto.Type.Name(field.type).removeprefix("TYPE_").lower()
    presence = ""
    if field.proto3_optional:
        presence = " with presence"
    elif field.HasField("oneof_index"):
        presence = f" in oneof {oneofs[field.oneof_index].name}"
    return f"{label} {kind}{presence}"


def _compare_enum(name: str, old: EnumDescriptorProto, new: EnumDescriptorProto) -> list[str]:
    findings = []
    new_numbers = {value.name: value.number for value in new.value}
    # Enum ranges include `end`, unlike those of messages.
    reserved = [range(entry.start, entry.end + 1) for entry in new.reserved_range]
    for value in old.value:
        what = f"The enum value {name}.{value.name} = {value.number}"
        if value.name in new_numbers:
            if new_numbers[value.name] != value.number:
                findings.append(f"{what} has become {new_numbers[value.name]}; numbers never change.")
        elif not (any(value.number in entry for entry in reserved) and value.name in new.reserved_name):
            findings.append(f"{what} is gone; bring it back, or reserve both its number and its name.")
    old_reserved = [range(entry.start, entry.end + 1) for entry in old.reserved_range]
    findings += _compare_reserved(
        name, old_reserved, reserved, lost_names=set(old.reserved_name) - {*new.reserved_name}
    )
    return findings


def _compare_reserved(name: str, old: list[range], new: list[range], lost_names: set[str]) -> list[str]:
    findings = [
        f"{name} no longer reserves the numbers {entry.start} to {entry.stop - 1}; they stay reserved for ever."
        for entry in old
        if not _covered(entry, new)
    ]
    findings += [f"{name} no longer reserves the name {lost!r}; it stays reserved." for lost in sorted(lost_names)]
    return findings


def _covered(wanted: range, ranges: list[range]) -> bool:
    """Return whether the ranges together contain `wanted`; ranges may reach to 2^29, so they are not expanded."""
    reached = wanted.start
    for entry in sorted(ranges, key=lambda entry: entry.start):
        if entry.start <= reached < entry.stop:
            reached = entry.stop
    return reached >= wanted.stop


def main(arguments: list[str] | None = None) -> int:
    """Compare and print breaking changes; return 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", default="HEAD", metavar="REV", help="git revision to compare with (default: HEAD)")
    parser.add_argument("--root", default=ROOT, type=Path, metavar="FOLDER", help="folder that holds duralab/")
    options = parser.parse_args(arguments)
    try:
        with tempfile.TemporaryDirectory() as folder:
            if not landed_contract(options.root, options.base, Path(folder)):
                sys.stderr.write(f"There is no contract at the git revision {options.base!r}: nothing to compare.\n")
                return 0
            old = compile_contract(Path(folder))
        findings = compare(old, compile_contract(options.root))
    except ContractError as error:
        findings = [str(error)]
    for finding in findings:
        sys.stderr.write(f"{finding}\n")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
