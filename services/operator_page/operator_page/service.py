"""Operator page on the bus: a client of the lab, like the command line, behind a web server."""

from __future__ import annotations

import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Final

import structlog
import uvicorn

from duralab.lab import Lab
from duralab_bus import Bus, ConfigError
from operator_page.accounts import read_accounts
from operator_page.certificates import CertificateProtocol, LoggedHandshake
from operator_page.commands import Commands
from operator_page.config import PageConfig
from operator_page.deliberation import Holders
from operator_page.lab_view import LabView
from operator_page.server import PageServer

NAME: Final = "operator_page"
_END_SECONDS: Final = 2.0


def build(config: PageConfig) -> Callable[[Bus], AbstractContextManager[object]]:
    """Return a function that serves the page to browsers until the block ends."""

    @contextmanager
    def serve(bus: Bus) -> Iterator[PageServer]:
        accounts = read_accounts(config.accounts) if config.accounts is not None else None
        if accounts is not None and accounts.certificates and (config.tls is None or config.tls.client_ca is None):
            raise ConfigError("accounts: some have a certificate; give the authority of those in `tls.client_ca`.")
        try:
            config.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"folder: {config.folder} cannot be made: {error.strerror}.") from error
        listening = _listen(config)
        lab, holders = Lab(bus, out=config.folder), Holders()
        view = LabView(lab, holders)
        commands = Commands(lab, view, holders, folder=config.folder)
        page = PageServer(lab=lab, view=view, commands=commands, config=config, accounts=accounts)
        _register_metrics(bus, page)
        server = uvicorn.Server(_web_config(page, config))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, name="page-web", daemon=True)
        thread.start()
        host, port = listening.getsockname()[:2]
        scheme = "http" if config.tls is None else "https"
        structlog.get_logger(NAME).info("page", address=f"{scheme}://{host}:{port}/")
        try:
            yield page
        finally:
            page.closing = server.should_exit = True
            view.close()
            thread.join(_END_SECONDS)

    return serve


def _listen(config: PageConfig) -> socket.socket:
    family = socket.AF_INET6 if ":" in config.host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((config.host, config.port))
        # From now on browsers wait until the web server runs, and are not refused.
        listening.listen(128)
    except OSError as error:
        listening.close()
        raise ConfigError(
            f"port: the page cannot listen at {config.host}:{config.port} ({error.strerror}); give another `port`."
        ) from error
    return listening


def _web_config(page: PageServer, config: PageConfig) -> uvicorn.Config:
    tls = config.tls
    authority = None if tls is None else tls.client_ca
    try:
        made = uvicorn.Config(
            page.app,
            http=CertificateProtocol,
            ws="none",
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            limit_concurrency=256,
            timeout_graceful_shutdown=1,
            ssl_certfile=None if tls is None else str(tls.certificate),
            ssl_keyfile=None if tls is None else str(tls.key),
            ssl_ca_certs=None if authority is None else str(authority),
            # People without a certificate sign in with a password.
            ssl_cert_reqs=ssl.CERT_NONE if authority is None else ssl.CERT_OPTIONAL,
        )
        made.load()
    except OSError as error:
        raise ConfigError(f"tls: the certificate, its key or `client_ca` cannot be used ({error}).") from error
    if made.ssl is not None:
        made.ssl.minimum_version = ssl.TLSVersion.TLSv1_3
        made.ssl.sslobject_class = LoggedHandshake
    return made


def _register_metrics(bus: Bus, page: PageServer) -> None:
    for name, what, read in (
        ("sessions", "People signed in at the page", lambda: len(page.sessions)),
        ("streams", "Pages that are open", lambda: page.streams),
    ):
        bus.metrics.follow(f"duralab_operator_page_{name}", what, lambda read=read: {(): float(read())})
