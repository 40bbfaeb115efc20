"""Access control of a secured lab: permissions of a member; the router silently drops all other messages."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import zenoh

from duralab_bus.faults import BusError, FaultError
from duralab_bus.session import (
    LARGEST_PAYLOAD_BYTES,
    LINK_SETTINGS,
    BusConfig,
    Identity,
    TlsConfig,
    check_identity,
    explain_failure,
)
from duralab_proto.access import (
    ACCESS,
    SMALL_QUERY_BYTES,
    KeyKind,
    Operation,
    permits,
)
from duralab_proto.keys import Keys
from duralab_proto.members import ADMIN, ROUTER, Member
from duralab_proto.v1 import query_pb2


class Permission:
    """Permissions of a session; a session without a certificate may try everything."""

    def __init__(self, identity: Identity | None, keys: Keys) -> None:
        self.member: Member | None = identity.member if identity is not None else None
        self._keys = keys

    def expect(self, operation: Operation, key: str) -> None:
        """Raise FaultError PERMISSION_DENIED if the router would drop this operation."""
        member = self.member
        if member is None or permits(member, operation, key, self._keys):
            return
        bound = f", bound to {', '.join([*member.rigs, member.project]).rstrip(', ')}," if member.bindings else ""
        raise FaultError(
            query_pb2.FAULT_CODE_PERMISSION_DENIED,
            f"{member.common_name} may not {operation} {key}: the role {member.role}{bound} does not include it; "
            "use the certificate of a member that may.",
        )


DEFAULT_PORT: Final = 7447
CERTIFICATES_FOLDER: Final = "/etc/duralab/certificates"
MOST_SESSIONS: Final = 64

# Messages that each operation sends to the router (ingress) and receives from it (egress), in Zenoh's terms. A
# publisher to which the router may not report subscribers sends nothing; the same applies to a client and queryables.
_MESSAGES: Final[Mapping[Operation, Mapping[str, tuple[str, ...]]]] = {
    Operation.ASK: {"ingress": ("query",), "egress": ("reply", "declare_queryable")},
    Operation.SERVE: {"ingress": ("declare_queryable", "reply"), "egress": ("query",)},
    Operation.PUBLISH: {"ingress": ("put",), "egress": ("declare_subscriber",)},
    Operation.RECEIVE: {"ingress": ("declare_subscriber",), "egress": ("put",)},
    Operation.HOLD: {"ingress": ("liveliness_token",)},
    Operation.WATCH: {
        "ingress": ("liveliness_query", "declare_liveliness_subscriber"),
        "egress": ("liveliness_token",),
    },
}

_HEAD: Final = """\
// The router of a secured lab, for zenohd {version}; docs/security.md explains it. Made by deploy/router/generate.py or
// `duralab certs router` from the access table in proto/duralab_proto/access.py: change the table, not this file.
"""


def router_configuration(
    members: Iterable[Member],
    *,
    lab: str = "local",
    version: str,
    certificates: str = CERTIFICATES_FOLDER,
    router: str = "main",
    port: int = DEFAULT_PORT,
) -> str:
    """Return the configuration of the router as JSON5.

    Parameters
    ----------
    members : iterable of Member
        Members that are let in. All others are refused everything, also with a certificate that is still valid: to
        withdraw a certificate, leave its member out.
    lab : str
        Name of the lab.
    version : str
        Version of Zenoh that the clients use.
    certificates : str
        Folder with `ca.crt`, `router.<name>.crt` and `router.<name>.key`, as the router sees it.
    router : str
        Name in the router's certificate.
    port : int
        Port at which it listens, on all interfaces.

    Returns
    -------
    str
        Configuration for `zenohd --config`.
    """
    keys = Keys(lab)
    own = f"{certificates.rstrip('/')}/{Member(ROUTER, router).common_name}"
    content: dict[str, Any] = {
        "mode": "router",
        "listen": {"endpoints": {"router": [f"tls/0.0.0.0:{port}"]}, "timeout_ms": 0, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": {"router": True, "peer": False, "client": False}},
        # Readable only for the members of the last policy: a certificate of the role admin, from this machine.
        "adminspace": {"enabled": True, "permissions": {"read": True, "write": False}},
        "transport": {
            "unicast": {
                "accept_timeout": 5000,
                "accept_pending": 32,
                "max_sessions": MOST_SESSIONS,
                "max_links": 1,
            },
            "shared_memory": {"enabled": False},
            "link": {
                "protocols": ["tls"],
                "tx": LINK_SETTINGS,
                "rx": {"max_message_size": LARGEST_PAYLOAD_BYTES},
                "tls": {
                    "root_ca_certificate": f"{certificates.rstrip('/')}/ca.crt",
                    "listen_certificate": f"{own}.crt",
                    "listen_private_key": f"{own}.key",
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "close_link_on_expiration": True,
                },
            },
        },
        "access_control": _access_control(keys, members),
        # Requests without a record are small: a larger one is dropped before it can overload the service.
        "low_pass_filter": [
            {
                "id": "small-queries",
                "flows": ["ingress"],
                "messages": ["query"],
                "key_exprs": _small_queries(keys),
                "size_limit": SMALL_QUERY_BYTES,
            }
        ],
    }
    return _HEAD.format(version=version) + json.dumps(content, indent=2) + "\n"


def _access_control(keys: Keys, members: Iterable[Member]) -> dict[str, Any]:
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    # A separate subject for each certificate, so that the permissions of one do not affect another.
    for member in sorted(members, key=lambda member: member.common_name):
        name = member.common_name
        if member.role == ROUTER:
            continue
        own = _admin_rules(name) if member.role == ADMIN else list(_rules(member, keys))
        here = {"interfaces": ["lo"]} if member.role == ADMIN else {}
        rules += own
        subjects.append({"id": name, "link_protocols": ["tls"], **here, "cert_common_names": [name]})
        policies.append({"id": name, "rules": [rule["id"] for rule in own], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _admin_rules(name: str) -> list[dict[str, Any]]:
    return [
        _rule(f"{name}-asks", "ingress", ("query",), ["@/**"]),
        _rule(f"{name}-is-answered", "egress", ("reply", "declare_queryable"), ["@/**"]),
    ]


def _rules(member: Member, keys: Keys) -> Iterator[dict[str, Any]]:
    """Yield the rules for the messages that the router accepts from a member, on its own keys only, and sends to it.

    The sent messages follow from the accepted ones. They are not narrowed to the member's keys: a service declares its
    keys for all names at once, and a client that may not see such a declaration sends no query.
    """
    for operation, flows in _MESSAGES.items():
        rows = [(row.expression(keys), row.expressions(member, operation, keys)) for row in ACCESS]
        allowed = {"ingress": [each for _, own in rows for each in own], "egress": [wide for wide, own in rows if own]}
        for flow, messages in flows.items():
            # In the order of the table, each once.
            if expressions := list(dict.fromkeys(allowed[flow])):
                yield _rule(f"{member.common_name}-{operation}-{flow}", flow, messages, expressions)


def _small_queries(keys: Keys) -> list[str]:
    return [row.expression(keys) for row in ACCESS if row.kind is KeyKind.QUERY and not row.bulk]


def _rule(id: str, flow: str, messages: Sequence[str], expressions: Sequence[str]) -> dict[str, Any]:
    return {
        "id": id,
        "permission": "allow",
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": list(expressions),
    }


@contextmanager
def run_router(configuration: str, *, listen: str) -> Iterator[None]:
    """Run the router of a secured lab, with its certificates and access control, until the `with` statement ends.

    Parameters
    ----------
    configuration : str
        Configuration from `router_configuration`.
    listen : str
        Endpoint at which it listens, instead of the one in the configuration, e.g. "tls/127.0.0.1:7447".

    Yields
    ------
    None
        When it accepts sessions. Zenoh's log goes to standard error, at the level of RUST_LOG, by default warnings.

    Raises
    ------
    BusError
        A certificate or key is missing, not usable or expired, or the endpoint cannot be used.
    """
    zenoh.init_log_from_env_or("warn")
    try:
        config = zenoh.Config.from_json5(configuration)
        config.insert_json5("listen/endpoints", json.dumps({"router": [listen]}))
        tls = json.loads(config.get_json("transport/link/tls"))
    except (zenoh.ZError, ValueError) as error:
        raise BusError(f"This is no configuration of a router: {error}; `duralab certs router` makes one.") from error
    # Zenoh does not name a missing file.
    ca, certificate, key = (
        Path(tls[name]) for name in ("root_ca_certificate", "listen_certificate", "listen_private_key")
    )
    check_identity(TlsConfig(ca=ca, certificate=certificate, key=key))
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        if "in use" in str(error):
            raise BusError(
                f"The endpoint {listen} is in use by another process; end that one, or choose another."
            ) from error
        raise BusError(explain_failure(str(error), BusConfig())) from error
    with session:
        yield
