"""Access control of a secured lab: what a role may do, and the router that enforces it."""

from duralab_bus.security.permission import Permission
from duralab_bus.security.router import DEFAULT_HOLDERS, DEFAULT_PORT, router_configuration, run_router

__all__ = [
    "DEFAULT_HOLDERS",
    "DEFAULT_PORT",
    "Permission",
    "router_configuration",
    "run_router",
]
