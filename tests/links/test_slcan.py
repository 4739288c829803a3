"""The SLCAN text: the C parser against a model in a few lines, and against Python's own reader and writer."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from terrapin_hil.firmware import Firmware
from terrapin_hil.links.slcan import slcan_line, slcan_parse

FIRMWARE = Firmware.open()
FFI, LIB = FIRMWARE.ffi, FIRMWARE.lib
MORE, DONE, FRAME = LIB.TERRAPIN_SLCAN_MORE, LIB.TERRAPIN_SLCAN_DONE, LIB.TERRAPIN_SLCAN_FRAME

frames = st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8))


class Parser:
    """The C parser; `feed` returns (frames, replies)."""

    def __init__(self) -> None:
        self.parser = FFI.new("terrapin_slcan *")
        LIB.terrapin_slcan_init(self.parser)

    def feed(self, data: bytes) -> tuple[list[tuple[int, bytes]], list[bytes]]:
        frame, reply = FFI.new("terrapin_frame *"), FFI.new("terrapin_slcan_reply *")
        found, replies = [], []
        for byte in data:
            event = LIB.terrapin_slcan_feed(self.parser, byte, frame, reply)
            if event != MORE:
                replies.append(bytes(reply.text)[: reply.length])
            if event == FRAME:
                found.append((frame.id, bytes(frame.data)[: frame.length]))
        return found, replies


def model(line: bytes, is_open: bool) -> tuple[bytes, tuple[int, bytes] | None, bool]:
    """(reply, frame, open afterwards) of one line, after the description of the protocol in slcan.h."""
    line = line.lstrip(b"\n")
    if len(line) > LIB.TERRAPIN_SLCAN_LINE_MAX:
        return b"\a", None, is_open
    match = re.fullmatch(rb"t([0-7][0-9A-Fa-f]{2})([0-8])((?:[0-9A-Fa-f]{2})*)", line, re.DOTALL)
    if match and len(match[3]) == 2 * int(match[2]):
        return (b"\r", (int(match[1], 16), bytes.fromhex(match[3].decode())), True) if is_open else (b"\a", None, False)
    match = re.fullmatch(rb"T[01][0-9A-Fa-f]{7}([0-8])((?:[0-9A-Fa-f]{2})*)", line, re.DOTALL)
    if match and len(match[2]) == 2 * int(match[1]):
        return b"\r" if is_open else b"\a", None, is_open
    if line == b"O":
        return b"\a" if is_open else b"\r", None, True
    if line == b"C":
        return b"\r", None, False
    if re.fullmatch(rb"S[0-8]", line):
        return b"\a" if is_open else b"\r", None, is_open
    answers = {b"": b"\r", b"Z0": b"\r", b"V": b"V0101\r", b"N": b"NTRPN\r", b"F": b"F00\r"}
    return answers.get(line, b"\a"), None, is_open


pieces = st.one_of(
    st.sampled_from([b"O", b"C", b"S6", b"V", b"N", b"F", b"L", b"Z0", b"Z1", b"", b"\n", b"r1230", b"s031C", b"\a"]),
    frames.map(lambda frame: slcan_line(frame)[:-1]),
    frames.map(lambda frame: slcan_line(frame)[:-1].upper().replace(b"T", b"t", 1)),
    st.tuples(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8)).map(
        lambda f: b"T%08X%d%s" % (f[0], len(f[1]), f[1].hex().encode())
    ),
    st.from_regex(rb"\A[tTrR][0-9a-fA-F]{0,12}\Z"),
    st.binary(max_size=40).map(lambda data: data.replace(b"\r", b"")),
)


@settings(max_examples=600, deadline=None)
@given(st.lists(pieces, max_size=12))
def test_parser_agrees_with_the_model(lines: list[bytes]) -> None:
    parser, is_open = Parser(), False
    for line in lines:
        reply, frame, is_open = model(line, is_open)
        assert parser.feed(line + b"\r") == ([] if frame is None else [frame], [reply])
        assert parser.parser.open == is_open


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes_give_one_reply_a_line(data: bytes) -> None:
    parser = Parser()
    found, replies = parser.feed(b"O\r" + data)
    assert len(replies) == data.count(b"\r") + 1
    assert all(reply.endswith((b"\r", b"\a")) for reply in replies)
    assert all(identifier <= 0x7FF for identifier, _ in found)


@settings(max_examples=400, deadline=None)
@given(frames)
def test_c_and_python_read_each_other(frame: tuple[int, bytes]) -> None:
    parser = Parser()
    assert parser.feed(b"O\r" + slcan_line(frame)) == ([frame], [b"\r", b"\r"])
    source, text = FFI.new("terrapin_frame *"), FFI.new("uint8_t[]", LIB.TERRAPIN_SLCAN_TEXT_MAX)
    source.id, source.length = frame[0], len(frame[1])
    source.data[0 : len(frame[1])] = frame[1]
    length = LIB.terrapin_slcan_encode(source, text)
    line = bytes(text)[:length]
    assert line[-1:] == b"\r"
    assert slcan_parse(line[:-1]) == frame


@pytest.mark.parametrize(
    "line", [b"", b"t", b"t123", b"t1239", b"t12310", b"t1231G0", b"t8000", b"t-010", b"t 010", b"t1231 1", b"t1_10",
             b"T000000000", b"t123111223344", b"t1231\xff\xff"]
)  # fmt: skip
def test_python_reader_refuses_what_is_no_frame(line: bytes) -> None:
    with pytest.raises(ValueError, match="no SLCAN frame"):
        slcan_parse(line)
