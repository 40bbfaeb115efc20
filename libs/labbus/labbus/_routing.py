"""A router in this process, from the configuration that a zenohd takes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh

from labbus._config import BusConfig, TlsConfig
from labbus._faults import BusError
from labbus._identity import check_identity
from labbus._session import explain_failure


@contextmanager
def run_router(configuration: str, *, listen: str) -> Iterator[None]:
    """Run the router of a secured lab, with its certificates and its access control, until the `with` statement ends.

    Parameters
    ----------
    configuration : str
        As `router_configuration` returns it.
    listen : str
        The endpoint it listens at, in place of the one in the configuration, e.g. "tls/127.0.0.1:7447".

    Yields
    ------
    None
        As soon as it accepts sessions. Zenoh's log goes to standard error, as far as RUST_LOG says, else warnings.

    Raises
    ------
    BusError
        One sentence: a certificate or key is missing, not usable or expired, or the endpoint cannot be used.
    """
    zenoh.init_log_from_env_or("warn")
    try:
        config = zenoh.Config.from_json5(configuration)
        config.insert_json5("listen/endpoints", json.dumps({"router": [listen]}))
        tls = json.loads(config.get_json("transport/link/tls"))
    except (zenoh.ZError, ValueError) as error:
        raise BusError(f"This is no configuration of a router: {error}; `duralab certs router` makes one.") from error
    # Zenoh does not name the file that is missing.
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
