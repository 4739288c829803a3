"""The same table in every format: 24 rows of 4 runs, written by its library, or by hand where there is none."""

from __future__ import annotations

import gzip
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

Columns = dict[str, npt.NDArray[np.float64]]
UNITS = {"speed": "rpm", "torque": "mN m", "temp": "degC"}


def numbers(seed: int, rows: int = 24) -> Columns:
    """Values whose every digit counts."""
    random = np.random.default_rng([38, seed])
    return {
        "speed": random.uniform(-3000, 3000, rows),
        "torque": random.uniform(0.01, 90, rows),
        "temp": random.uniform(15, 40, rows),
    }


def runs(rows: int = 24) -> list[str]:
    return [f"V{i // 6 + 1}" for i in range(rows)]


def _heads() -> list[str]:
    return [f"{name} [{unit}]" for name, unit in UNITS.items()]


def csv(path: Path, columns: Columns) -> None:
    rows = zip(runs(), *(column.tolist() for column in columns.values()), strict=True)
    lines = [",".join(["run", *_heads()]), *(",".join([run, *map(repr, values)]) for run, *values in rows)]
    path.write_text("\n".join(lines) + "\n")


def csv_gz(path: Path, columns: Columns) -> None:
    plain = path.with_suffix("")
    csv(plain, columns)
    path.write_bytes(gzip.compress(plain.read_bytes()))
    plain.unlink()


def zipped(path: Path, columns: Columns) -> None:
    """A file for each run."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for run in dict.fromkeys(runs()):
            mine = np.array([one == run for one in runs()])
            rows = zip(*(column[mine].tolist() for column in columns.values()), strict=True)
            packed.writestr(f"{run}.csv", "\n".join([",".join(_heads()), *(",".join(map(repr, row)) for row in rows)]))


def xlsx(path: Path, columns: Columns) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["run", *_heads()])
    for run, *values in zip(runs(), *(column.tolist() for column in columns.values()), strict=True):
        sheet.append([run, *values])
    book.save(path)


def xlsx_headed(path: Path, columns: Columns) -> None:
    """A title, merged headings of two rows, a row of units, a sheet of notes; runs are merged cells."""
    import openpyxl

    book = openpyxl.Workbook()
    notes = book.active
    notes.title = "Notes"
    notes["A1"] = "Bearing rig, wet"
    sheet = book.create_sheet("Data")
    sheet["B2"], sheet["B3"] = "Test of 2026", "Operator"
    for at, text in {"B5": "", "C5": "Motor", "E5": "Oil", "B6": "run", "C6": "speed", "D6": "torque", "E6": "temp",
                     "C7": "1/min", "D7": "mNm", "E7": "\u00b0C"}.items():  # fmt: skip
        sheet[at] = text
    sheet.merge_cells("C5:D5")
    for i, (run, *values) in enumerate(zip(runs(), *(c.tolist() for c in columns.values()), strict=True)):
        if i % 6 == 0:
            sheet.cell(8 + i, 2, run)
        for j, value in enumerate(values):
            sheet.cell(8 + i, 3 + j, value)
    for i in range(0, 24, 6):
        sheet.merge_cells(start_row=8 + i, end_row=13 + i, start_column=2, end_column=2)
    book.save(path)


def xlsx_sheets(path: Path, columns: Columns) -> None:
    """A sheet for each run."""
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for run in dict.fromkeys(runs()):
        sheet = book.create_sheet(run)
        sheet.append(_heads())
        for own, *values in zip(runs(), *(column.tolist() for column in columns.values()), strict=True):
            if own == run:
                sheet.append(values)
    book.save(path)


def ods(path: Path, columns: Columns) -> None:
    """As LibreOffice writes it, with its empty rows to the sheet's end."""

    def cell(value: object) -> str:
        if isinstance(value, str):
            return f'<table:table-cell office:value-type="string"><text:p>{escape(value)}</text:p></table:table-cell>'
        return f'<table:table-cell office:value-type="float" office:value="{value!r}"></table:table-cell>'

    rows = [["run", *_heads()], *zip(runs(), *(column.tolist() for column in columns.values()), strict=True)]
    text = "".join(f"<table:table-row>{''.join(map(cell, row))}</table:table-row>" for row in rows)
    space = "urn:oasis:names:tc:opendocument:xmlns:"
    content = (
        f'<?xml version="1.0" encoding="UTF-8"?><office:document-content xmlns:office="{space}office:1.0" '
        f'xmlns:table="{space}table:1.0" xmlns:text="{space}text:1.0"><office:body><office:spreadsheet>'
        f'<table:table table:name="Data">{text}<table:table-row table:number-rows-repeated="1048000">'
        '<table:table-cell table:number-columns-repeated="1024"/></table:table-row></table:table>'
        "</office:spreadsheet></office:body></office:document-content>"
    )
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("mimetype", kind)
        packed.writestr("content.xml", content)
        packed.writestr(
            "META-INF/manifest.xml",
            f'<manifest:manifest xmlns:manifest="{space}manifest:1.0"><manifest:file-entry manifest:full-path="/" '
            f'manifest:media-type="{kind}"/></manifest:manifest>',
        )


def mat(path: Path, columns: Columns, compress: bool = True) -> None:
    import scipy.io

    cells = np.array(runs(), dtype=object)
    scipy.io.savemat(path, {"run": cells, **columns, "units": UNITS}, do_compression=compress)


def mat_structs(path: Path, columns: Columns) -> None:
    """An array of structs, a run each."""
    import scipy.io

    structs = np.zeros(4, dtype=[(name, object) for name in (*columns, "units")])
    for i in range(4):
        for name, column in columns.items():
            structs[i][name] = column[6 * i : 6 * i + 6]
        structs[i]["units"] = UNITS
    scipy.io.savemat(path, {"test": structs})


def mat_73(path: Path, columns: Columns) -> None:
    """As MATLAB writes `save -v7.3`: HDF5 behind a block of 512 bytes, arrays turned round, cells as references."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, column in columns.items():
            file.create_dataset(name, data=column.reshape(1, -1)).attrs["MATLAB_class"] = np.bytes_(b"double")
        kept = file.create_group("#refs#")
        found = []
        for i, run in enumerate(runs()):
            text = kept.create_dataset(f"r{i}", data=np.array([[ord(c)] for c in run], dtype=np.uint16))
            text.attrs["MATLAB_class"] = np.bytes_(b"char")
            found.append(text.ref)
        cell = file.create_dataset("run", (1, len(found)), dtype=h5py.ref_dtype)
        cell[0, :] = found
        cell.attrs["MATLAB_class"] = np.bytes_(b"cell")
        units = file.create_group("units")
        units.attrs["MATLAB_class"] = np.bytes_(b"struct")
        for name, unit in UNITS.items():
            text = units.create_dataset(name, data=np.array([[ord(c)] for c in unit], dtype=np.uint16))
            text.attrs["MATLAB_class"] = np.bytes_(b"char")
    with path.open("r+b") as out:
        out.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def hdf5(path: Path, columns: Columns) -> None:
    """A group for each run, units as attributes."""
    import h5py

    with h5py.File(path, "w") as file:
        for run in dict.fromkeys(runs()):
            mine = np.array([one == run for one in runs()])
            group = file.create_group(f"tests/{run}")
            for name, column in columns.items():
                group.create_dataset(name, data=column[mine], compression="gzip").attrs["units"] = UNITS[name]


def netcdf_4(path: Path, columns: Columns) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        row = file.create_dataset("row", data=np.arange(24.0))
        row.make_scale("row")
        for name, column in columns.items():
            item = file.create_dataset(name, data=column)
            item.dims[0].attach_scale(row)
            item.attrs["units"] = UNITS[name]
        file.create_dataset("run", data=np.array(runs(), dtype="S2"))


def netcdf_3(path: Path, columns: Columns) -> None:
    import scipy.io

    with scipy.io.netcdf_file(path, "w") as file:
        file.createDimension("row", 24)
        file.createDimension("letters", 2)
        for name, column in columns.items():
            variable = file.createVariable(name, "d", ("row",))
            variable[:] = column
            variable.units = UNITS[name]
        variable = file.createVariable("run", "c", ("row", "letters"))
        variable[:] = np.array([list(run) for run in runs()], dtype="S1")


def _arrow(columns: Columns) -> object:
    import pyarrow

    schema = [pyarrow.field("run", pyarrow.string())]
    schema += [pyarrow.field(n, pyarrow.float64(), metadata={"unit": UNITS[n]}) for n in columns]
    return pyarrow.table([pyarrow.array(runs()), *map(pyarrow.array, columns.values())], schema=pyarrow.schema(schema))


def feather(path: Path, columns: Columns) -> None:
    import pyarrow.feather

    pyarrow.feather.write_feather(_arrow(columns), path)


def parquet(path: Path, columns: Columns) -> None:
    import pyarrow.parquet

    pyarrow.parquet.write_table(_arrow(columns), path)


def npz(path: Path, columns: Columns) -> None:
    names = dict(zip((f"{name} [{UNITS[name]}]" for name in columns), columns.values(), strict=True))
    np.savez_compressed(path, run=np.array(runs()), **names)


def tdms(path: Path, columns: Columns) -> None:
    import nptdms

    channels = [nptdms.ChannelObject("test", "run", runs())]
    channels += [nptdms.ChannelObject("test", n, c, properties={"unit_string": UNITS[n]}) for n, c in columns.items()]
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(channels)


def _ros(writer: object, columns: Columns, one: bool) -> None:
    """A joint's state: name, position, velocity, effort stand for run, speed, torque, temp."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
    State, Header, Time = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    connection = writer.add_connection("/joint", State.__msgtype__, typestore=store)  # type: ignore[attr-defined]
    for i, (run, *values) in enumerate(zip(runs(), *columns.values(), strict=True)):
        stamp = {"sec": i, "nanosec": 0}
        header = Header(seq=i, stamp=Time(**stamp), frame_id="a") if one else Header(stamp=Time(**stamp), frame_id="a")
        message = State(header, [run], *(np.array([value]) for value in values))
        raw = (
            store.serialize_ros1(message, State.__msgtype__) if one else store.serialize_cdr(message, State.__msgtype__)
        )
        writer.write(connection, 10**9 * (5 + i), bytes(raw))  # type: ignore[attr-defined]


def bag(path: Path, columns: Columns) -> None:
    from rosbags.rosbag1 import Writer

    with Writer(path) as writer:
        _ros(writer, columns, True)


def bag_2(path: Path, columns: Columns) -> None:
    from rosbags.rosbag2 import Writer

    with Writer(path, version=9) as writer:
        _ros(writer, columns, False)


def mcap(path: Path, columns: Columns) -> None:
    """JSON, as Foxglove and the tools around it write it."""
    import json

    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="test")
        schema = writer.register_schema("rig", "jsonschema", b'{"type": "object"}')
        units = {f"unit.{name}": unit for name, unit in UNITS.items()}
        channel = writer.register_channel("/rig", "json", schema, units)
        for i, (run, *values) in enumerate(zip(runs(), *(c.tolist() for c in columns.values()), strict=True)):
            message = json.dumps({"run": run, **dict(zip(columns, values, strict=True))}).encode()
            writer.add_message(channel, 10**9 * (5 + i), message, 10**9 * (5 + i))
        writer.finish()


ROS = {"name.0": "run", "position.0": "speed", "velocity.0": "torque", "effort.0": "temp"}
Write = Callable[[Path, Columns], None]
WRITERS: dict[str, tuple[str, Write]] = {
    "csv": ("a.csv", csv),
    "csv.gz": ("a.csv.gz", csv_gz),
    "zip": ("a.zip", zipped),
    "xlsx": ("a.xlsx", xlsx),
    "xlsx headed": ("a.xlsx", xlsx_headed),
    "xlsx sheets": ("a.xlsx", xlsx_sheets),
    "ods": ("a.ods", ods),
    "mat 5": ("a.mat", lambda path, columns: mat(path, columns, False)),
    "mat 7": ("a.mat", mat),
    "mat structs": ("a.mat", mat_structs),
    "mat 7.3": ("a.mat", mat_73),
    "hdf5": ("a.h5", hdf5),
    "netcdf 3": ("a.nc", netcdf_3),
    "netcdf 4": ("a.nc", netcdf_4),
    "feather": ("a.feather", feather),
    "parquet": ("a.parquet", parquet),
    "npz": ("a.npz", npz),
    "tdms": ("a.tdms", tdms),
    "mcap": ("a.mcap", mcap),
    "ros 1": ("a.bag", bag),
    "ros 2": ("bag", bag_2),
}
