"""An SLCAN adapter on a pty, fed with a full bus: `slcan_feeder.py RATE SECONDS [held]` prints the path of the pty,
waits until the channel is opened (and, held, for a line), sends, and prints what it sent as JSON. The text is made
before; sending costs little. RATE 0 sends 1,000 frames a "second" as fast as they are taken.

Frames carry the identifiers of the controller's telemetry in turn, and their number in their first four bytes.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
import tty
from pathlib import Path

from terrapin_hil.messages import interface

SLICE = 5e-3  # s between writes: less than a kB of a full bus, as an adapter on USB gives it


def texts(rate: int, seconds: float) -> list[bytes]:
    """What is written every SLICE."""
    whole = [m for m in interface().messages.values() if m.sender == "controller" and m.length == 8]
    names = [m.id for m in whole if m.name != "IDENTITY"]  # made-up numbers there are those of another's controller
    lines = []
    for number in range(round(rate * seconds)):
        wave = (number // len(names)) % 4096
        data = number.to_bytes(4, "little") + wave.to_bytes(2, "little") + b"\1\0"
        lines.append(b"t%03X8%s\r" % (names[number % len(names)], data.hex().upper().encode()))
    each = max(1, round(rate * SLICE))
    return [b"".join(lines[i : i + each]) for i in range(0, len(lines), each)]


class Feeder:
    """The feeder as a process: `path` to be opened as serial:PATH, `sent()` once it has sent everything.

    held: nothing is sent before `go()`, for a test that has more to do first than to open the channel.
    """

    def __init__(self, rate: int, seconds: float, held: bool = False) -> None:
        command = [sys.executable, str(Path(__file__).resolve()), str(rate), str(seconds), *(["held"] if held else [])]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.path = self._process.stdout.readline().strip()

    def go(self) -> None:
        """Lets a held feeder send."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()

    @property
    def output(self) -> int:
        """Descriptor that is readable once everything is sent."""
        assert self._process.stdout is not None
        return self._process.stdout.fileno()

    def waiting(self) -> bool:
        """Whether it still sends."""
        return not select.select([self.output], [], [], 0)[0]

    def sent(self) -> dict[str, float]:
        """Waits until all is sent: frames, seconds, by how much the latest write was late, its own share of a core."""
        assert self._process.stdout is not None
        return dict(json.loads(self._process.stdout.readline()))

    def close(self) -> None:
        """Pulls the plug."""
        self._process.kill()
        self._process.communicate()

    def __enter__(self) -> Feeder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def write(descriptor: int, text: bytes) -> None:
    while text:
        text = text[os.write(descriptor, text) :]


def main(rate: int, seconds: float, held: bool = False) -> None:
    pieces = texts(rate or 1000, seconds)
    master, slave = os.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    heard = b""
    while not heard.endswith(b"O\r"):
        heard = (heard + os.read(master, 4096))[-64:]
    os.close(slave)  # the reader holds it now; its end is then ours to see
    if held:
        sys.stdin.readline()
    else:
        time.sleep(0.3)
    begin, latest, busy = time.monotonic(), 0.0, time.process_time()
    for number, piece in enumerate(pieces):
        due = begin + number * SLICE if rate else 0.0
        wait = due - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        write(master, piece)
        latest = max(latest, time.monotonic() - due) if rate else 0.0
    took = time.monotonic() - begin
    cores = (time.process_time() - busy) / took
    sent = {"sent": round((rate or 1000) * seconds), "seconds": took, "latest": latest, "cores": cores}
    print(json.dumps(sent), flush=True)
    sys.stdin.readline()  # keep the pty until told


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3:] == ["held"])
