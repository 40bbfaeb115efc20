"""What a rig says while it plays, on one line that is safe to print."""

import pytest

from duralab_proto.v1 import query_pb2
from iterator.campaign.rig_playback import LONGEST_WORDS, words_of


@pytest.mark.parametrize(
    ("phase", "detail", "said"),
    [
        ("playing", "a.i01", ""),
        ("waiting for the operator", "a.i01", "waiting for the operator"),
        ("waiting\x1b[2J to press start", "run a.i01", "waiting [2J to press start, run a.i01"),
        ("two\nlines", "", "two lines"),
        ("x" * 10_000, "", "x" * LONGEST_WORDS + "…"),
    ],
)
def test_words_are_one_line_without_what_is_no_news(phase, detail, said):
    assert words_of(query_pb2.Progress(phase=phase, detail=detail), run="a.i01") == said
