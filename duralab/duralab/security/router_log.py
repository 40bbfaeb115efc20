"""Refusals of a router, read from the log of its access control.

Zenoh logs every decision of its access control at level trace and a refused certificate as a warning, with
`RUST_LOG=warn,zenoh_link_tls::unicast=debug,zenoh::net::routing::interceptor::access_control=trace`. The log also
contains lookups of all permissions of a key in advance, which are no attempts; they are skipped here.
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
    """Refusal of a router, with time (ISO 8601 in UTC), common name of the certificate, and Zenoh's session id.

    `what`: Zenoh's name of the action: "Put", "Query", "Declare Subscriber", …; or "join" for a link. `key`: Key or key
    expression; for a link, the reason.
    """

    time: str
    who: str
    session: str
    what: str
    key: str


def read_refusals(lines: Iterable[str]) -> Iterator[Refusal]:
    """Yield the refusals in the lines of a router's log; skip other lines."""
    names: dict[str, str] = {}
    # A thread looks up all permissions of a key in sequence; lines of other threads may be in between.
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
