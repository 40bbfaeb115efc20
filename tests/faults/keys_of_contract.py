"""Every key of the contract with the messages it takes, read from the key space itself: no new key is forgotten."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from google.protobuf.message import Message

import duralab_proto.v1 as generated
from duralab_proto.keys import Keys
from duralab_proto.v1 import identifier_pb2, iterator_pb2, query_pb2, recorder_pb2, rig_pb2, sequencer_pb2

from .malformed import TEXTS

_MODULES = (rig_pb2, identifier_pb2, iterator_pb2, recorder_pb2, sequencer_pb2, query_pb2)
_QUERY = re.compile(r"Query: (\w+) →")
_STREAM = re.compile(r"[Ss]tream of (\w+)")
NO_MESSAGES = frozenset({"live", "asking", "within"})
"""Methods of the key space whose keys carry no message."""


@dataclass(frozen=True)
class ContractKey:
    """One key, as a query or as a stream.

    Parameters
    ----------
    name : str
        Of the method of `Keys`.
    make : callable
        Returns the key for the names it takes.
    names : tuple of str
        What it has to be given: "rig", "run", "id", "service" or "instance".
    kind : type
        The message it takes.
    stream : bool
        Whether it is published on, else asked.
    """

    name: str
    make: Callable[..., str]
    names: tuple[str, ...]
    kind: type[Message]
    stream: bool


def message_kind(name: str) -> type[Message]:
    """Return the class of a message of the contract.

    Raises
    ------
    LookupError
        There is none of that name.
    """
    for module in (*_MODULES, *(value for value in vars(generated).values() if inspect.ismodule(value))):
        if hasattr(module, name):
            kind: type[Message] = getattr(module, name)
            return kind
    raise LookupError(f"The contract has no message {name!r}.")


def contract_keys(keys: Keys) -> list[ContractKey]:
    """Return all keys of a lab that carry messages, queries first and streams after them.

    Raises
    ------
    LookupError
        A key does not say what it carries.
    """
    found: list[ContractKey] = []
    for name, method in inspect.getmembers(keys, inspect.ismethod):
        if name.startswith("_") or name in NO_MESSAGES:
            continue
        said = inspect.getdoc(method) or ""
        names = tuple(inspect.signature(method).parameters)
        queries, streams = _QUERY.findall(said), _STREAM.findall(said)
        if not queries and not streams:
            raise LookupError(f"Keys.{name} does not say what it carries: 'Query: A → B' or 'Stream of A'.")
        found += [ContractKey(name, method, names, message_kind(kind), stream=False) for kind in queries]
        found += [ContractKey(name, method, names, message_kind(kind), stream=True) for kind in streams]
    return sorted(found, key=lambda key: (key.stream, key.name))


def odd_name_in(path: str, key: ContractKey, random: np.random.Generator) -> str:
    """Put an odd name where one stands in the key; what is no key of Zenoh's is not sent."""
    odd = [text for text in TEXTS if text and not set(text) & set("*$#?/") and len(text) < 1000]
    name = odd[int(random.integers(len(odd)))] if key.names else "main"
    chunks = path.split("/")
    # Of several names the first; the prefix and the lab hold none that it could be taken for.
    place = key.make(*["*"] * len(key.names)).split("/").index("*") if key.names else len(chunks) - 1
    chunks[place] = name
    return "/".join(chunks)
