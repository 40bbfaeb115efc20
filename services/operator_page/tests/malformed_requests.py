"""Requests that are nearly right: values exchanged, keys too many, bytes broken."""

import http.client
import json
import random

from page_lab import Client

REQUESTS = 1000
WORDS = ("", "x", "../..", "%2e%2e", "\u202e", "<b>", "null", "'; drop", "a" * 300, "\ud83d", "0", "-1", "1e999")
VALUES = (None, True, 0, -1, 2**70, 1e308, "", "x", "\x00", "é" * 600, [], [[[]]], {}, {"a": {"b": []}})


def malformed(random_one: random.Random, values: dict) -> bytes:
    """Return a body that is nearly right: a value exchanged, a key too many, or bytes broken."""
    kind = random_one.randrange(5)
    if kind == 0:
        return bytes(random_one.randrange(256) for _ in range(random_one.randrange(400)))
    document = {**values, "seen": random_one.choice(VALUES), "word": random_one.choice(VALUES)}
    if kind == 1 and values:
        document[random_one.choice(list(values))] = random_one.choice(VALUES)
    elif kind == 2:
        document[random_one.choice(WORDS)] = random_one.choice(VALUES)
    text = json.dumps(document)
    if kind == 3:
        at = random_one.randrange(len(text))
        text = text[:at] + random_one.choice(WORDS) + text[at + random_one.randrange(4) :]
    if kind == 4:
        text = "[" * random_one.randrange(1, 60_000) + text
    return text.encode("utf-8", "surrogatepass")


def raw(client: Client, method: str, path: str, body: bytes, headers: dict):
    connection = http.client.HTTPConnection(client.host, timeout=30.0)
    try:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()
