"""The text of a PDF as Chromium writes it: enough of the format to read what a browser printed, no library."""

import re
import zlib


def printed_pages(pdf: bytes) -> list[str]:
    """Return the text of each page, without white space: a PDF places words, it does not separate them."""
    objects = {int(number): body for number, body in re.findall(rb"(?:^|\n)(\d+) 0 obj\s(.*?)endobj", pdf, re.DOTALL)}
    fonts = {number: _characters(body, objects) for number, body in objects.items() if b"/ToUnicode" in body}
    pages = [body for body in objects.values() if re.search(rb"/Type\s*/Page\b", body)]
    return [_page(body, objects, fonts) for body in pages]


def _stream(body: bytes) -> bytes:
    return zlib.decompressobj().decompress(body.partition(b"stream")[2].lstrip(b"\r\n"))


def _characters(font: bytes, objects: dict[int, bytes]) -> dict[int, str]:
    """Return the characters of the glyphs of a font, from its map to Unicode."""
    found = re.search(rb"/ToUnicode (\d+) 0 R", font)
    assert found is not None
    table = _stream(objects[int(found[1])]).decode()
    characters = {}
    for kind, block in re.findall(r"begin(bfchar|bfrange)(.*?)endbf", table, re.DOTALL):
        codes = [int(code, 16) for code in re.findall(r"<([0-9A-Fa-f]+)>", block)]
        if kind == "bfchar":
            characters |= {glyph: chr(code) for glyph, code in zip(codes[::2], codes[1::2], strict=True)}
        else:
            for low, high, code in zip(codes[::3], codes[1::3], codes[2::3], strict=True):
                characters |= {glyph: chr(code + glyph - low) for glyph in range(low, high + 1)}
    return characters


def _page(page: bytes, objects: dict[int, bytes], fonts: dict[int, dict[int, str]]) -> str:
    names = {name: int(number) for name, number in re.findall(rb"/(F\d+) (\d+) 0 R", page)}
    contents = re.search(rb"/Contents (\d+) 0 R", page)
    assert contents is not None
    text, font = [], {}
    tokens = re.finditer(rb"/(F\d+) [\d.]+ Tf|<([0-9A-Fa-f]+)>", _stream(objects[int(contents[1])]))
    for token in tokens:
        if token[1]:
            font = fonts[names[token[1]]]
        else:
            codes = token[2].decode()
            text += [font.get(int(codes[at : at + 4], 16), "") for at in range(0, len(codes), 4)]
    return "".join("".join(text).split())
