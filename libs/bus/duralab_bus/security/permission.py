"""What the role in a session's certificate lets it do, said at once: the router drops the rest without a word."""

from __future__ import annotations

from duralab_bus.faults import FaultError
from duralab_bus.session import Identity
from duralab_proto.access import Holder, Operation, Role, permits
from duralab_proto.keys import Keys
from duralab_proto.v1 import query_pb2


class Permission:
    """Tells whether a session may do something; one without a certificate may try everything.

    `identity`: Who the session is to a secured lab. `keys`: Of the lab.
    """

    def __init__(self, identity: Identity | None, keys: Keys) -> None:
        self._holder: Holder | None = identity.holder if identity is not None else None
        self._keys = keys

    def expect(self, operation: Operation, key: str) -> None:
        """Raise FaultError, PERMISSION_DENIED, where the router would drop this."""
        holder = self._holder
        if holder is None:
            return
        role = Role(holder.role) if holder.role in set(Role) else None
        if role is None or not permits(role, operation, key, self._keys):
            raise FaultError(
                query_pb2.FAULT_CODE_PERMISSION_DENIED,
                f"{holder.common_name} may not {operation} {key}: the role {holder.role} does not include it; "
                "use the certificate of a role that does.",
            )
