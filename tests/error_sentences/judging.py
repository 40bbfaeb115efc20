"""What every error sentence must be."""

from __future__ import annotations

import re

from .page import PAGE, row
from .provoking import REMEDY, Provocation, Provoked


def judge(one: Provocation, answer: Provoked) -> None:
    """Assert exit code and one sentence with the value and what is allowed or to be done; and that the page has it."""
    assert answer.code == one.exit, answer
    assert "Traceback" not in answer.stdout + answer.stderr
    assert answer.stderr.startswith("Error: ")
    assert answer.stderr.count("\n") == 1, answer.stderr
    sentence = answer.sentence
    assert re.search(r"[^.][.?]$", sentence)
    assert one.value in sentence
    rest = re.split(r"[;,]| so ", sentence, maxsplit=1)[-1]
    assert one.allowed in sentence if one.allowed else REMEDY.search(rest), f"{sentence!r} says not what to do."
    assert row(one, answer) in PAGE.read_text(encoding="utf-8").splitlines(), (
        "The page has another sentence: run `python -m tests.error_sentences.page` and read what changed."
    )
