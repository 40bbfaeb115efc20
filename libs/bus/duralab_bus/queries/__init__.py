"""Queries: client, server, and the log of refused queries."""

from duralab_bus.queries.call import Call, Handler
from duralab_bus.queries.client import OVERDUE, Cancel, QueryClient
from duralab_bus.queries.server import QueryServer, Served

__all__ = [
    "OVERDUE",
    "Call",
    "Cancel",
    "Handler",
    "QueryClient",
    "QueryServer",
    "Served",
]
