from __future__ import annotations

from recorder.live.pieces import PIECE_SECONDS, Piece


def test_a_piece_is_due_when_its_first_item_has_waited_long_enough():
    now = [100.0]
    piece: Piece[str] = Piece(clock=lambda: now[0])
    now[0] += 10.0
    assert not piece.due, "nothing waits"
    piece.add("first")
    now[0] += 0.9 * PIECE_SECONDS
    piece.add("second")
    assert not piece.due
    now[0] += 0.2 * PIECE_SECONDS
    assert piece.due
    assert (piece.first, piece.last) == ("first", "second")
    assert piece.take() == ["first", "second"]
    assert (piece.first, piece.last, piece.due, piece.take()) == (None, None, False, [])
    piece.add("third")
    assert not piece.due, "it has only just come"
