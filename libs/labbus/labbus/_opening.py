"""Joining the bus."""

from __future__ import annotations

from labbus._bus import Bus
from labbus._config import BusConfig
from labbus._identity import check_identity
from labbus._session import open_session


def open_bus(config: BusConfig | None = None, *, service: str, workers: int = 4) -> Bus:
    """Join the bus.

    Parameters
    ----------
    config : BusConfig, optional
        How; an unconnected peer on loopback where not given.
    service : str
        Who joins, e.g. "rig_sim"; named in the faults it answers.
    workers : int
        Queries of one key answered at once, 1 or more.

    Returns
    -------
    Bus
        Open; to be closed.

    Raises
    ------
    BusError
        One sentence: a port is in use, nothing listens at an endpoint of `connect`, or the session is refused.
    """
    config = config or BusConfig()
    identity = check_identity(config.tls) if config.tls is not None else None
    session, listening = open_session(config)
    return Bus(session, config, service=service, workers=workers, listening=listening, identity=identity)
