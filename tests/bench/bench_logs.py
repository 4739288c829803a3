"""Decoding a log to arrays against cantools, message by message, in one run: the same frames, the same numbers."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

import cantools
import numpy as np

from terrapin_hil import paths
from terrapin_tools.logs import candump
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import Frames, frames
from terrapin_tools.logs.reading import read_log

ROUNDS, COUNT, BOUND = 5, 40_000, 10.0


def bus(dbc: Path) -> Frames:
    """Telemetry as the controller sends it: all its messages in turn, any data."""
    random = np.random.default_rng(1)
    names = [m.frame_id for m in cantools.database.load_file(dbc).messages if m.length == 8]
    payloads = [random.bytes(8) for _ in range(COUNT)]
    identifiers = [names[i % len(names)] for i in range(COUNT)]
    return frames(Path("made"), np.arange(COUNT) / 8000, identifiers, payloads, [0] * COUNT)


def main() -> int:
    dbc = paths.build() / "generated" / "terrapin.dbc"
    log, decoder, database = bus(dbc), Decoder(dbc), cantools.database.load_file(dbc)
    ratios, rates, texts = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.log"
        with path.open("w") as file:
            rows = zip(log.times.tolist(), log.identifiers.tolist(), range(COUNT), strict=True)
            file.writelines(candump.line(t, i, log.payload(row)) + "\n" for t, i, row in rows)
        for _ in range(ROUNDS):
            begin = perf_counter()
            fast = decoder.decode(log)
            middle = perf_counter()
            slow = [
                database.decode_message(int(log.identifiers[row]), log.payload(row), decode_choices=False)
                for row in range(COUNT)
            ]
            end = perf_counter()
            ratios.append((end - middle) / (middle - begin))
            rates.append(COUNT / (middle - begin))
            begin = perf_counter()
            read_log(path)
            texts.append(COUNT / (perf_counter() - begin))
    for table in fast.values():
        for place, row in enumerate(table.rows):
            for name, values in table.signals.items():
                if not np.isclose(values[place], slow[row][name], rtol=1e-13, atol=0):
                    print(f"frame {row}, {name}: {values[place]} is not {slow[row][name]}")
                    return 1
    ratio = median(ratios)
    print(f"decoding to arrays: {median(rates):.3g} frames/s, {ratio:.0f} times cantools' (bound {BOUND:.0f})")
    print(f"reading candump text: {median(texts):.3g} frames/s")
    return 0 if ratio >= BOUND else 1


if __name__ == "__main__":
    sys.exit(main())
