"""Sentences of others put beside one's own."""

from __future__ import annotations


def ended(sentence: str) -> str:
    """Return a sentence with its full stop: a service may leave it out, and another sentence follows."""
    text = sentence.rstrip()
    return text if text.endswith((".", "!", "?")) else f"{text}."
