"""Queries: the client that asks, the server that answers, and the log of refused ones."""

from labbus.queries.call import Call, Handler
from labbus.queries.client import Cancel, QueryClient
from labbus.queries.server import QueryServer, Served

__all__ = [
    "Call",
    "Cancel",
    "Handler",
    "QueryClient",
    "QueryServer",
    "Served",
]
