"""Refusals of a router, read from the log of its access control.

Zenoh logs every decision of its access control at level trace and a refused certificate as a warning, with
`RUST_LOG=warn,zenoh_link_tls::unicast=debug,zenoh::net::routing::interceptor::access_control=trace`. Between the real
attempts stand the answers to all questions that could be asked of a key, looked up in advance; they are left out here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

_LINE: Final = re.compile(
    r"^(?P<time>\S+)\s+[A-Z]+\s+(?P<thread>.*?ThreadId\(\d+\))\s+(?P<target>[a-z_]\S*): (?P<text>.*)$"
)
_COLOUR: Final = re.compile(r"\x1b\[[0-9;]*m")
_SUBJECT: Final = re.compile(r"^(?P<session>[0-9a-f]+) on (?P<subject>\S+) is ")
_DENIED: Final = re.compile(
    r"(?P<session>[0-9a-f]+)(?: on \S+)? is unauthorized to (?P<what>.+) \(ingress\) on (?P<key>.+)$"
)
_COMMON_NAME: Final = re.compile(r"CertCommonName\(([^)]*)\)")
_IN_ADVANCE: Final = "caching permissions for"
_LAST_IN_ADVANCE: Final = " to Declare Liveliness Subscriber ("
_UNKNOWN: Final = re.compile(r"^(?P<session>[0-9a-f]+) did not match any configured ACL subject")
_HANDSHAKE: Final = re.compile(r"^(?P<why>.*?)\. Hint: increase the system open file limit\.$")
_ACCESS: Final = "zenoh::net::routing::interceptor::access_control"
_TLS: Final = "zenoh_link_tls::unicast"


@dataclass(frozen=True)
class Refusal:
    """One thing that a router refused: when (ISO 8601 in UTC), and to whom by certificate or Zenoh's id of the session.

    `what`: In Zenoh's words: "Put", "Query", "Declare Subscriber", …; or "join" of a link. `key`: On which key or key
    expression; of a link, why it was refused.
    """

    time: str
    who: str
    session: str
    what: str
    key: str


def read_refusals(lines: Iterable[str]) -> Iterator[Refusal]:
    """Yield what the lines of a router's log say was refused; other lines are passed over."""
    names: dict[str, str] = {}
    # A thread looks up all permissions of a key in one go; what other threads log comes in between.
    in_advance: set[str] = set()
    for raw in lines:
        line = _LINE.match(_COLOUR.sub("", raw.rstrip("\n")))
        if line is None:
            continue
        text, thread = line["text"], line["thread"]
        if line["target"] == _TLS:
            if failed := _HANDSHAKE.match(text):
                yield Refusal(line["time"], "", "", "join", failed["why"])
            continue
        if line["target"] != _ACCESS:
            continue
        if subject := _SUBJECT.match(text):
            name = _COMMON_NAME.search(subject["subject"])
            names[subject["session"]] = name[1] if name else ""
        if _IN_ADVANCE in text:
            in_advance.add(thread)
        elif thread in in_advance:
            if _LAST_IN_ADVANCE in text:
                in_advance.discard(thread)
        elif denied := _DENIED.search(text):
            session = denied["session"]
            yield Refusal(line["time"], names.get(session, ""), session, denied["what"], denied["key"])
        elif unknown := _UNKNOWN.match(text):
            yield Refusal(line["time"], "", unknown["session"], "join", "the router knows nobody of that common name")
