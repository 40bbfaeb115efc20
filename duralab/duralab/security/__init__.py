"""Members of a secured lab, their certificates, and refusals in its router's log."""

from duralab.security.certificates import (
    AUTHORITY,
    CertificateFile,
    configure_router,
    init_authority,
    issue,
    issue_missing,
    read_certificates,
    renew,
)
from duralab.security.members import MemberEntry, read_members
from duralab.security.router_log import read_refusals

__all__ = [
    "AUTHORITY",
    "CertificateFile",
    "MemberEntry",
    "configure_router",
    "init_authority",
    "issue",
    "issue_missing",
    "read_certificates",
    "read_members",
    "read_refusals",
    "renew",
]
