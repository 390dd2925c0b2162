# SPDX-License-Identifier: Apache-2.0
"""Lines are cut the same however the stream comes in, and never kept beyond a length."""

import io
import tracemalloc
from itertools import pairwise

from hypothesis import example, given
from hypothesis import strategies as st

from stickslip_ros.emulator.controller import Lines

STREAMS = st.lists(st.sampled_from([b"a", b"bc", b"\r", b"\n", b"\r\n", b"\xff"]), max_size=40)


@example(parts=[b"a", b"\r\n"], cuts=[2, 2])
@given(STREAMS, st.lists(st.integers(0, 60), max_size=8))
def test_lines_are_those_of_python_however_they_are_cut(
    parts: list[bytes], cuts: list[int]
) -> None:
    stream = b"".join(parts)
    lines = Lines(1000)
    ends = [0, *sorted(cuts), len(stream)]
    found = [line for a, b in pairwise(ends) for line in lines.take(stream[a:b])]
    read = io.TextIOWrapper(io.BytesIO(stream + b"."), encoding="latin-1", newline=None).read()
    assert found == [line.encode("latin-1") for line in read.split("\n")[:-1]]


def test_a_long_line_is_told_once_and_takes_no_memory() -> None:
    lines = Lines(10)
    assert lines.take(b"0123456789\n") == [b"0123456789"]
    tracemalloc.start()
    for _ in range(1000):
        assert lines.take(b"x" * 1000) == []
    assert tracemalloc.get_traced_memory()[0] < 10_000
    tracemalloc.stop()
    assert lines.take(b"\nshort\n" + b"y" * 11 + b"\n") == [None, b"short", None]
