"""What a log holds, gathered block by block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import ERROR, EXTENDED, REMOTE, Frames

__all__ = ["Summary", "describe"]

GAP = 20.0  # times a message's usual period: so long a silence is told
FEW = 5  # frames of a message from which it has a usual period


_Name = tuple[int, bool, int]  # identifier, whether of 29 bits, number of the bus


class Summary:
    """Counts, rates, error frames, gaps and steps back in time."""

    def __init__(self, decoder: Decoder | None) -> None:
        self._names = {key: str(m.name) for key, m in decoder.messages.items()} if decoder else {}
        self._count: dict[_Name, int] = {}
        self._span: dict[_Name, tuple[float, float]] = {}
        self._longest: dict[_Name, tuple[float, float]] = {}  # silence, when it began
        self._total = self._errors = self._remote = self._back = 0
        self._first = self._last = self._latest = 0.0

    def take(self, block: Frames) -> None:
        """One block more, in file order."""
        if not len(block):
            return
        if not self._total:
            self._first = self._latest = float(block.times[0])
        running = np.maximum.accumulate(np.concatenate([[self._latest], block.times]))
        self._back += int((block.times < running[:-1]).sum())
        self._latest = float(running[-1])
        self._total += len(block)
        self._last = float(block.times[-1])
        self._errors += int((block.flags & ERROR != 0).sum())
        self._remote += int((block.flags & REMOTE != 0).sum())
        data = block.data_frames
        keys = (data.identifiers * 2 + (data.flags & EXTENDED)) * 256 + data.bus
        for key in np.unique(keys):
            name = (int(key) // 512, bool(key // 256 % 2), int(key) % 256)
            times = data.times[keys == key]
            begin, end = self._span.get(name, (float(times[0]), float(times[0])))
            steps = np.diff(np.concatenate([[end], times]))
            widest = int(np.argmax(steps))
            silence = float(steps[widest])
            if silence > self._longest.get(name, (0.0, 0.0))[0]:
                self._longest[name] = (silence, float(times[widest]) - silence)
            self._span[name] = (begin, float(times[-1]))
            self._count[name] = self._count.get(name, 0) + len(times)

    def answer(self) -> dict[str, Any]:
        """As JSON: begin and end [s], frames, messages by identifier."""
        messages = []
        for name in sorted(self._count):
            count, (begin, end) = self._count[name], self._span[name]
            period = (end - begin) / (count - 1) if count > 1 else None
            silence, at = self._longest.get(name, (0.0, 0.0))
            usual = count >= FEW and period is not None
            gap = usual and silence > GAP * (end - begin - silence) / max(1, count - 2) and silence > 0
            messages.append(
                {
                    "id": name[0],
                    "extended": name[1],
                    "name": self._names.get(name[:2]),
                    "bus": name[2],
                    "frames": count,
                    "period": period,
                    "gap": {"begin": at, "seconds": silence} if gap else None,
                }
            )
        return {
            "begin": self._first,
            "end": self._last,
            "frames": self._total,
            "error_frames": self._errors,
            "remote_frames": self._remote,
            "steps_back": self._back,
            "messages": messages,
        }


def describe(answer: Mapping[str, Any]) -> str:
    """The answer for people."""
    seconds = answer["end"] - answer["begin"]
    rate = f", {answer['frames'] / seconds:.0f}/s" if seconds > 0 else ""
    rows = [f"{answer['log']}: {answer['frames']} frames in {seconds:.6g} s{rate}, {answer['bytes'] / 1e6:.3g} MB"]
    if answer["cut"]:
        rows.append(f"  read up to where it was cut off: {answer['cut']}")
    rows += [f"  {text}" for text in (answer["lost"], *answer["assumed"]) if text]
    buses = answer["buses"] if len(answer["buses"]) > 1 else []
    if buses:
        rows.append(f"  buses: {', '.join(buses)}")
    for key, text in (("error_frames", "error frames"), ("remote_frames", "remote frames")):
        if answer[key]:
            rows.append(f"  {answer[key]} {text if answer[key] > 1 else text.removesuffix('s')}")
    if answer["steps_back"]:
        rows.append(f"  {answer['steps_back']} frames with a time before the frame before them")
    for message in answer["messages"]:
        name = f"{message['id']:08X}" if message["extended"] else f"{message['id']:03X}"
        period = f"every {message['period'] * 1e3:.4g} ms" if message["period"] is not None else "once"
        gap = message["gap"]
        silent = f"   silent for {gap['seconds']:.3g} s from {gap['begin']:.3f} s on" if gap else ""
        bus = f"  {buses[message['bus']]:<6}" if buses else ""
        rows.append(f"{bus}  {name:>8}  {message['name'] or '':<18} {message['frames']:>9}  {period}{silent}")
    return "\n".join(rows)
