"""Certificates of a secured lab, and the refusals in its router's log."""

from duralab.security.certificates import (
    AUTHORITY,
    CertificateFile,
    configure_router,
    init_authority,
    issue,
    read_certificates,
    renew,
)
from duralab.security.router_log import read_refusals

__all__ = [
    "AUTHORITY",
    "CertificateFile",
    "configure_router",
    "init_authority",
    "issue",
    "read_certificates",
    "read_refusals",
    "renew",
]
