"""TDMS files of LabVIEW: a part for each group, a column for each channel; a waveform's clock is the column `time`."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection
from pathlib import Path

import numpy as np

from terrapin_tools.bounded import refuse_beyond
from terrapin_tools.workbench.files.format import Asked, Column, Format, Part, cells


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """Channels of the length that most in a group have. UserError for more than it may stand for."""
    import nptdms
    from nptdms.log import log_manager

    log_manager.set_level(logging.CRITICAL)  # of a broken file the complaint is one line
    found = []
    with nptdms.TdmsFile.open(path) as file:
        size = sum(len(channel) * 8 for group in file.groups() for channel in group.channels())
        refuse_beyond(path, size)
        for group in file.groups():
            lengths = Counter(len(channel) for channel in group.channels() if len(channel))
            if not lengths:
                continue
            rows = max(lengths, key=lambda n: (lengths[n], n))
            columns: dict[str, Column] = {}
            units = {}
            others = []
            for channel in group.channels():
                if len(channel) != rows:
                    others += [channel.name] if len(channel) else []
                    continue
                values = np.asarray(channel[:])
                if values.dtype.kind == "M":
                    columns[channel.name] = np.where(np.isnat(values), "", values.astype(str))
                elif values.dtype.kind in "fiub":
                    columns[channel.name] = values.astype(np.float64)
                else:
                    columns[channel.name] = cells(values.tolist())
                unit = channel.properties.get("unit_string", channel.properties.get("NI_UnitDescription", ""))
                units[channel.name] = str(unit)
                step = channel.properties.get("wf_increment", 0.0)
                if step and "time" not in columns and "time" not in group:
                    begin = float(channel.properties.get("wf_start_offset", 0.0))
                    columns = {"time": begin + float(step) * np.arange(rows), **columns}
                    units["time"] = "s"
            notes = [f"left out, as not of {rows} rows: {', '.join(others[:4])}"] if others else []
            found.append(Part(group.name, columns, units, 0, tuple(notes)))
    return found


FORMAT = Format("a TDMS file", (".tdms",), read, part="group", package="nptdms", extra="tdms")
