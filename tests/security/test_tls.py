"""The router speaks TLS 1.3 and nothing older, with its three ciphers that encrypt and authenticate at once."""

from __future__ import annotations

import os
import socket
import ssl
import subprocess
import sys
from pathlib import Path

import pytest

from .secured_router import SecuredRouter

# Python cannot choose the ciphers of TLS 1.3; OpenSSL reads them from its configuration at the start of a process.
_OPENSSL = "openssl_conf = a\n[a]\nssl_conf = b\n[b]\nsystem_default = c\n[c]\nCiphersuites = {cipher}\n"


def context(certificates: Path) -> ssl.SSLContext:
    """Return what a member of the lab shows."""
    made = ssl.create_default_context(cafile=str(certificates / "ca.crt"))
    made.load_cert_chain(certificates / "operator.main.crt", certificates / "operator.main.key")
    return made


def negotiated(port: int, shown: ssl.SSLContext) -> tuple[str, str]:
    with (
        socket.create_connection(("127.0.0.1", port), timeout=20.0) as plain,
        shown.wrap_socket(plain, server_hostname="localhost") as link,
    ):
        cipher, version, _ = link.cipher() or ("", "", 0)
        return version, cipher


def test_a_member_that_speaks_an_older_version_is_refused(router: SecuredRouter, certificates: Path):
    shown = context(certificates)
    assert negotiated(router.port, shown)[0] == "TLSv1.3"
    shown.maximum_version = ssl.TLSVersion.TLSv1_2
    with pytest.raises(ssl.SSLError, match="PROTOCOL_VERSION"):
        negotiated(router.port, shown)


@pytest.mark.parametrize(
    ("cipher", "accepted"),
    [
        ("TLS_AES_256_GCM_SHA384", True),
        ("TLS_AES_128_GCM_SHA256", True),
        ("TLS_CHACHA20_POLY1305_SHA256", True),
        ("TLS_AES_128_CCM_SHA256", False),
        ("TLS_AES_128_CCM_8_SHA256", False),
    ],
)
def test_a_cipher_is_one_of_three(
    router: SecuredRouter, certificates: Path, tmp_path: Path, cipher: str, accepted: bool
):
    configuration = tmp_path / "openssl.cnf"
    configuration.write_text(_OPENSSL.format(cipher=cipher))
    done = subprocess.run(
        [sys.executable, "-m", "tests.security.test_tls", str(router.port), str(certificates)],
        cwd=Path(__file__).resolve().parents[2],
        env={**os.environ, "OPENSSL_CONF": str(configuration)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if accepted:
        assert done.stdout.split() == ["TLSv1.3", cipher]
    else:
        assert done.returncode != 0
        assert "HANDSHAKE_FAILURE" in done.stderr


if __name__ == "__main__":
    sys.stdout.write(" ".join(negotiated(int(sys.argv[1]), context(Path(sys.argv[2])))))
