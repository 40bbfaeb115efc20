"""Certificates of a secured lab, and the refusals in its router's log."""

from duralab.security.certificate_files import AUTHORITY, CertificateFile, read_certificates
from duralab.security.certificates import configure_router, init_authority, issue, renew
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
