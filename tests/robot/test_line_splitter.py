"""Lines that arrive in pieces, and what never ends."""

import random

from mercator_design.robot.protocols.lines import MAX_LINE, LineSplitter


def test_lines_are_the_same_in_all_pieces():
    draw, sent = random.Random(3), b"\n".join([b"", b"one", b"x" * MAX_LINE, b"x" * (MAX_LINE + 1), b"last", b"begun"])
    for size in (100, 4096, len(sent)):
        splitter, found, at = LineSplitter(), [], 0
        while at < len(sent):
            piece = sent[at : at + draw.randint(1, size)]
            found += splitter.receive(piece)
            at += len(piece)
        assert found == [b"", b"one", b"x" * MAX_LINE, b"last"], size
        assert splitter.receive(b"\n") == [b"begun"]


def test_a_line_that_does_not_end_takes_no_memory():
    splitter = LineSplitter()
    for _ in range(200):
        assert splitter.receive(b"x" * MAX_LINE) == []
    assert len(splitter._begun) == MAX_LINE + 1
    assert splitter.receive(b"\nnext\n") == [b"next"]
