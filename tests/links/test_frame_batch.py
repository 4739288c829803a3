"""Several CAN frames in one call: on a pair of sockets of this machine, which keep messages apart as a bus does."""

from __future__ import annotations

import socket

import pytest

from terrapin_hil.links.frame_batch import MOST, FrameBatch

FRAMES = [(0x100, bytes(range(8))), (0x101, b""), (0x7FF, b"\xff")]


def test_all_frames_go_out_in_one_call_and_come_in_one() -> None:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here, there:
        batch = FrameBatch()
        batch.pack(FRAMES)
        assert batch.send(here.fileno(), 0, 3) == 3
        assert FrameBatch().receive(there.fileno()) == FRAMES


def test_the_rest_is_sent_from_where_the_first_call_ended() -> None:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here, there:
        batch, heard = FrameBatch(), FrameBatch()
        frames = [(0x100 + i, bytes([i])) for i in range(MOST)]
        batch.pack(frames)
        assert batch.send(here.fileno(), 0, 5) == 5
        assert heard.receive(there.fileno()) == frames[:5]
        assert batch.send(here.fileno(), 5, MOST - 5) == MOST - 5
        assert heard.receive(there.fileno()) == frames[5:]


def test_errors_are_those_of_the_system() -> None:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here:
        batch = FrameBatch()
        batch.pack(FRAMES)
        there.setblocking(False)
        with pytest.raises(BlockingIOError):
            batch.receive(there.fileno())
        there.close()
        with pytest.raises(BrokenPipeError):
            batch.send(here.fileno(), 0, 1)
