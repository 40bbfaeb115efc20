"""Damaged YAMLs, model descriptions and archives: a rig, or one sentence; never anything else."""

import re
import zipfile

import numpy as np
import pytest

from rig_sim import SpecimenError, load_any_rig

ROUNDS = 150
TOKENS = [
    b"-1",
    b"0",
    b"1e999",
    b".nan",
    b"''",
    b"[]",
    b"{}",
    b"null",
    b"true",
    b"front.force",
    b"\xff",
    b"\n",
    b":",
    b"<",
    b'"',
]


def damaged(content, generator):
    """Return bytes with a piece overwritten, taken out, doubled, or replaced by a token."""
    begin = int(generator.integers(len(content)))
    end = begin + int(generator.integers(1, 12))
    piece = [
        bytes(generator.integers(0, 256, end - begin, dtype=np.uint8)),
        b"",
        content[begin:end] * 2,
        TOKENS[generator.integers(len(TOKENS))],
    ][generator.integers(4)]
    return content[:begin] + piece + content[end:]


def damage_yaml(yaml, fmu, generator):
    lines = yaml.read_bytes().split(b"\n")
    row = int(generator.integers(len(lines)))
    match generator.integers(3):
        case 0:
            yaml.write_bytes(damaged(yaml.read_bytes(), generator))
        case 1:
            del lines[row]
            yaml.write_bytes(b"\n".join(lines))
        case _:
            lines[row] = re.sub(rb": .*", b": " + TOKENS[generator.integers(len(TOKENS))], lines[row])
            yaml.write_bytes(b"\n".join(lines))


def damage_description(yaml, fmu, generator):
    with zipfile.ZipFile(fmu) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = "modelDescription.xml"
    text = members[name]
    words = re.findall(rb'"[^"]*"', text)
    old, new = (words[generator.integers(len(words))] for _ in range(2))
    members[name] = text.replace(old, new, 1) if generator.integers(2) else damaged(text, generator)
    with zipfile.ZipFile(fmu, "w") as archive:
        for member, content in members.items():
            archive.writestr(member, content)


def damage_archive(yaml, fmu, generator):
    content = fmu.read_bytes()
    cut = content[: int(generator.integers(len(content)))]
    fmu.write_bytes(cut if generator.integers(3) == 0 else damaged(content, generator))


@pytest.mark.timeout(900)
@pytest.mark.parametrize("damage", [damage_yaml, damage_description, damage_archive])
def test_whatever_is_damaged_there_is_a_rig_or_a_sentence(write, damage):
    generator = np.random.default_rng(5)
    refused = []
    for _ in range(ROUNDS):
        path = write(fmi=int(generator.integers(2, 4)))
        damage(path, path.with_name("two_post.fmu"), generator)
        try:
            load_any_rig(path)
        except SpecimenError as error:
            refused.append(str(error))
    assert [sentence for sentence in refused if not re.fullmatch(r"specimen .*[.?]", sentence)] == []
    assert [sentence for sentence in refused if str(path.parent) in sentence] == []
    assert len(refused) > ROUNDS // 5
