"""Logs that explain themselves, opened by the tools of others: names, units, words for values, the DBC inside."""

from __future__ import annotations

import json
from pathlib import Path

import can
import cantools
import numpy as np
import pyarrow.parquet
import pytest
from mcap.reader import make_reader

import terrapin_tools as terrapin
from terrapin_hil import paths
from terrapin_hil.messages import interface
from terrapin_tools.logs.reading import LogReader, read_log
from tests import command


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> terrapin.Log:
    folder = tmp_path_factory.mktemp("log") / "run"
    with terrapin.Session("steady_sand", log=folder) as s:
        s.step(1.5)
    return terrapin.Log(folder)


STATES = {number: name for name, number in interface().enums["state"].items()}


def test_mcap(log: terrapin.Log, tmp_path: Path) -> None:
    file = log.save(tmp_path / "x.mcap")
    with file.open("rb") as opened:
        reader = make_reader(opened)
        (attached,) = reader.iter_attachments()
        assert attached.name == "terrapin.dbc"
        assert cantools.database.load_string(attached.data.decode("latin-1"), "dbc").get_message_by_name("GROUND")
        seen: dict[str, list[object]] = {}
        for schema, channel, message in reader.iter_messages(topics=["/GROUND", "/STATUS"]):
            assert schema is not None
            properties = json.loads(schema.data)["properties"]
            if channel.topic == "/GROUND":
                assert channel.metadata["unit.torque"] == "N m"
                assert properties["torque"]["type"] == "number"
                assert properties["torque"]["description"].startswith("[N m]")
                assert properties["valid"]["type"] == "boolean"
            else:
                words = {one["const"]: one["title"] for one in properties["state"]["oneOf"]}
                assert words == STATES
            for name, value in json.loads(message.data).items():
                seen.setdefault(name, []).append(value)
    assert {type(value) for value in seen["valid"]} == {bool}
    assert {type(value) for value in seen["state"]} == {int}
    assert set(seen["state"]) <= set(STATES)
    assert seen["torque"] == log["GROUND.torque"]["GROUND.torque"].to_pylist()


def test_mf4(log: terrapin.Log, tmp_path: Path) -> None:
    from asammdf import MDF

    file = log.save(tmp_path / "x.mf4")
    with MDF(file) as mdf:
        (attachment,) = [mdf.extract_attachment(index=i) for i in range(len(mdf.attachments))]
        assert attachment[0] == paths.dbc().read_bytes()
        torque = mdf.get("torque", group=_group(mdf, "GROUND"))
        assert torque.unit == "N m"
        assert np.array_equal(torque.samples, log["GROUND.torque"]["GROUND.torque"].to_numpy())
        group = _group(mdf, "STATUS")
        words = mdf.get("state", group=group).samples
        numbers = mdf.get("state", group=group, raw=True).samples
        assert [STATES[int(n)] for n in numbers] == [w.decode() for w in words]
        assert set(words) >= {b"run"} or {b"idle"} & set(words)
    assert len(read_log(file)[0]) == len(read_log(log.path)[0])  # the frames are what they were
    assert terrapin.Log(file)["GROUND.torque"].num_rows == log["GROUND.torque"].num_rows


def _group(mdf: object, name: str) -> int:
    groups = mdf.groups  # type: ignore[attr-defined]
    return next(i for i, group in enumerate(groups) if group.channel_group.acq_name == name)


def test_parquet(log: terrapin.Log, tmp_path: Path) -> None:
    frames = pyarrow.parquet.read_table(log.save(tmp_path / "frames.parquet"))
    assert frames.schema.metadata[b"dbc"] == paths.dbc().read_bytes()
    to = tmp_path / "signals.parquet"
    command.terrapin("log", "convert", log.path, to, "--period", "10 ms")
    table = pyarrow.parquet.read_table(to)
    assert table.schema.field("GROUND.torque").metadata[b"unit"] == b"N m"
    numbers, words = table["STATUS.state"].to_pylist(), table["STATUS.state_word"].to_pylist()
    assert [None if n != n else STATES[int(n)] for n in numbers] == words
    assert pyarrow.types.is_dictionary(table.schema.field("STATUS.state_word").type)
    assert table.schema.metadata[b"dbc"] == paths.dbc().read_bytes()


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_python_can_reads_it_and_the_description_in_it_decodes_it(
    log: terrapin.Log, tmp_path: Path, suffix: str
) -> None:
    file = log.save(tmp_path / f"x{suffix}")
    database = cantools.database.load_file(paths.dbc())
    identifier = database.get_message_by_name("STATUS").frame_id
    with can.LogReader(file) as reader:
        states = {
            str(database.decode_message(m.arbitration_id, m.data)["state"])
            for m in reader
            if m.arbitration_id == identifier
        }
    assert states <= set(STATES.values())
    assert states


def test_a_description_that_does_not_match_says_nothing(log: terrapin.Log, tmp_path: Path) -> None:
    dbc = tmp_path / "other.dbc"
    dbc.write_text(
        'VERSION ""\nBS_:\nBU_:\nBO_ 2000 OTHER: 8 Vector__XXX\n SG_ x : 0|8@1+ (1,0) [0|0] "V" Vector__XXX\n'
    )
    other = terrapin.Log(log.path, dbc)
    assert other.signals == {}
    with pytest.raises(terrapin.errors.InputError, match=r"found no GROUND\.torque"):
        other["GROUND.torque"]
    with pytest.raises(terrapin.errors.InputError, match="found no frame that the DBC knows"):
        other.table()


def test_a_strangers_mcap_is_one_line(tmp_path: Path) -> None:
    from mcap.writer import Writer

    file = tmp_path / "stranger.mcap"
    with file.open("wb") as opened:
        writer = Writer(opened)
        writer.start(profile="", library="another")
        schema = writer.register_schema("pose", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/pose", "json", schema), 0, b"{}", 0)
        writer.finish()
    with pytest.raises(terrapin.errors.InputError) as caught:
        terrapin.Log(file).table()
    assert "stranger.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_ros_2_bag(log: terrapin.Log, tmp_path: Path) -> None:
    """Opened by rosbags, with no type known beforehand: names, units, words for values as constants, frames."""
    rosbags = pytest.importorskip("rosbags.highlevel")
    command.terrapin("log", "convert", log.path, tmp_path / "x.rosbag2")
    with rosbags.AnyReader([tmp_path / "x.rosbag2"]) as reader:
        known = {connection.topic: connection for connection in reader.connections}
        assert reader.typestore is not None
        definition = known["/ground"].msgdef.data
        assert "float64 torque # [N m] " in definition
        words = {name: value for name, kind, value in reader.typestore.fielddefs["terrapin_msgs/msg/Status"][0]}
        assert {f"STATE_{name.upper()}": number for number, name in STATES.items()}.items() <= words.items()
        found = [
            reader.deserialize(raw, "terrapin_msgs/msg/Ground")
            for _, _, raw in reader.messages(connections=[known["/ground"]])
        ]
        frames = sum(1 for _ in reader.messages(connections=[known["/can"]]))
    assert [one.torque for one in found] == log["GROUND.torque"]["GROUND.torque"].to_pylist()
    assert {type(one.valid) for one in found} == {bool}
    assert frames == len(read_log(log.path)[0])
    assert "GROUND.torque: N m" in (tmp_path / "x.rosbag2" / "metadata.yaml").read_text().replace('"', "").replace(
        "unit.", ""
    )
    again = ("log", "convert", log.path, tmp_path / "x.rosbag2")
    assert "exists already" in command.terrapin(*again, status=2).stderr
    command.terrapin(*again, "--force")
    (tmp_path / "own.rosbag2").mkdir()
    into_own = ("log", "convert", log.path, tmp_path / "own.rosbag2", "--force")
    assert "no bag" in command.terrapin(*into_own, status=2).stderr


def test_signals_beside_the_frames_of_an_mf4_are_no_lost_rows(log: terrapin.Log, tmp_path: Path) -> None:
    """Of our own, which has its frames decoded as well, it was said that thousands of rows gave no frame. Frames that
    python-can passes over still count."""
    from asammdf import MDF

    reader = LogReader(log.save(tmp_path / "own.mf4"))
    frames = sum(map(len, reader.blocks()))
    assert reader.lost == ""
    assert reader.assumed == [
        "groups of signals are no frames, and not read: COMMAND, SENSORS_SLOW, SENSORS_FAST and 10 more"
    ]
    with MDF(tmp_path / "own.mf4") as mdf:
        mdf.groups[0].channel_group.flags = 0
        mdf.save(tmp_path / "unmarked.mf4")
    reader = LogReader(tmp_path / "unmarked.mf4")
    assert sum(map(len, reader.blocks())) == 0
    assert reader.lost == f"{frames} rows gave no frame, records of a bus that python-can does not read as CAN frames"
