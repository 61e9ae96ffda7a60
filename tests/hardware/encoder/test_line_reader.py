from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from armctl.hardware.encoder.messages import LineReader


def test_lines_with_either_end_and_empty_ones():
    assert LineReader(5).feed(b"one\ntwo\r\n\n\r\nthr") == [b"one", b"two", b"", b""]


def test_a_line_of_exactly_the_longest_length():
    reader = LineReader(5)
    assert reader.feed(b"12345\n12345\r\n") == [b"12345", b"12345"]
    assert reader.feed(b"123456\n12345x\r\n1\n") == [None, None, b"1"]


def test_a_flood_without_an_end_is_not_kept():
    reader = LineReader(5)
    for _ in range(1000):
        assert reader.feed(b"x" * 1000) == []
    assert len(reader._pending) <= 6
    assert reader.feed(b"\nok\n") == [None, b"ok"]


@given(st.lists(st.binary(max_size=8).map(lambda b: b.replace(b"\n", b"").replace(b"\r", b""))), st.data())
def test_the_pieces_do_not_matter(lines, data):
    stream = b"".join(line + b"\n" for line in lines)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    reader = LineReader(6)
    found: list[bytes | None] = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += reader.feed(stream[start:end])
    assert found == [line if len(line) <= 6 else None for line in lines]
