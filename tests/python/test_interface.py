"""The one description: what is made of it agrees with an independent reader, and bad descriptions are refused."""

from __future__ import annotations

import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cantools
import pint
import pytest

from terrapin_hil import paths
from terrapin_hil.firmware import Firmware, ParameterError
from terrapin_hil.messages import crc8, interface, protect
from terrapin_hil.physics.effects import catalogue
from terrapin_hil.physics.expression import parse as parse_expression
from terrapin_interface import description as description_module
from terrapin_interface import unread as unread_module
from terrapin_interface.description import CONTROLLER_TOML, load, parse
from terrapin_interface.entries import DescriptionError, Promise
from terrapin_interface.generate import generate
from terrapin_interface.reference import markdown
from terrapin_interface.robot import find_robot, load_robot
from terrapin_interface.unread import unread
from tests.interface_mutations.planted import GOOD, PLANTED

FRAMES = 100_000


@pytest.fixture(scope="module")
def firmware() -> Firmware:
    return Firmware.open()


@pytest.fixture(scope="module")
def database() -> cantools.database.Database:
    return cantools.database.load_file(paths.build() / "generated" / "terrapin.dbc")


def fields(message, struct):
    return {signal.name: int(getattr(struct, signal.name)) for signal in message.signals}


def test_differential_random_frames(firmware: Firmware, database) -> None:
    """100,000 random frames: cantools, the compiled codec and the Python codec read the same numbers, and write them
    back to the same bits."""
    ffi, lib = firmware.ffi, firmware.lib
    messages = list(firmware.interface.messages.values())
    generator = random.Random(1)
    frame, again = ffi.new("terrapin_frame *"), ffi.new("terrapin_frame *")
    for number, message in enumerate(messages):
        name = message.name.lower()
        struct = ffi.new(f"terrapin_{name}_t *")
        decode, encode = getattr(lib, f"terrapin_decode_{name}"), getattr(lib, f"terrapin_encode_{name}")
        oracle = database.get_message_by_frame_id(message.id)
        assert oracle.length == message.length
        mask = sum(((1 << s.length) - 1) << s.start for s in message.signals)
        full_range = all((s.minimum, s.maximum) == _bits_range(s) for s in message.signals)
        frame.id, frame.length = message.id, message.length
        for _ in range(FRAMES // len(messages) + (number < FRAMES % len(messages))):
            data = generator.randbytes(message.length)
            frame.data[0 : message.length] = data
            assert decode(frame, struct)
            raw = fields(message, struct)
            assert raw == oracle.decode(data, decode_choices=False, scaling=False)
            assert raw == message.decode(data)
            if full_range:
                assert encode(struct, again)
                used = int.from_bytes(data, "little") & mask
                assert bytes(again.data)[: message.length] == used.to_bytes(message.length, "little")
                assert (again.id, again.length) == (message.id, message.length)


def _bits_range(signal) -> tuple[int, int]:
    if signal.signed:
        return -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    return 0, (1 << signal.length) - 1


def test_differential_scaled_values(firmware: Firmware, database) -> None:
    generator = random.Random(2)
    for message in firmware.interface.messages.values():
        oracle = database.get_message_by_frame_id(message.id)
        for _ in range(200):
            data = generator.randbytes(message.length)
            assert message.physical(data) == pytest.approx(oracle.decode(data, decode_choices=False), rel=1e-12, abs=0)


def test_encoders_clamp_and_flag(firmware: Firmware, database) -> None:
    """Values far outside: each encoder clamps to the signal's range, says so, and touches no neighbouring signal."""
    ffi, lib = firmware.ffi, firmware.lib
    generator = random.Random(3)
    for message in firmware.interface.messages.values():
        name = message.name.lower()
        struct, frame = ffi.new(f"terrapin_{name}_t *"), ffi.new("terrapin_frame *")
        oracle = database.get_message_by_frame_id(message.id)
        for _ in range(2000):
            wanted = {}
            for signal in message.signals:
                low, high = (0, 2**32 - 1) if signal.maximum > 2**31 - 1 else (-(2**31), 2**31 - 1)
                edge = generator.choice(
                    [signal.minimum, signal.maximum, signal.minimum - 1, signal.maximum + 1, low, high]
                )
                value = min(max(generator.choice([edge, generator.randint(signal.minimum, signal.maximum)]), low), high)
                setattr(struct, signal.name, value)
                wanted[signal.name] = value
            clamped = {s.name: min(max(wanted[s.name], s.minimum), s.maximum) for s in message.signals}
            exact = getattr(lib, f"terrapin_encode_{name}")(struct, frame)
            data = bytes(frame.data)[: message.length]
            assert exact == (clamped == wanted)
            assert oracle.decode(data, decode_choices=False, scaling=False) == clamped
            assert message.encode(wanted) == (data, exact)


def test_the_dbc_names_each_fault_bit(database) -> None:
    said = database.get_message_by_name("STATUS").get_signal_by_name("faults").comment
    for name, bit in interface().faults.items():
        assert f"bit {bit} {name}" in said


def test_dbc_says_what_the_description_says(database) -> None:
    d = load()
    assert [m.frame_id for m in sorted(database.messages, key=lambda m: m.frame_id)] == sorted(m.id for m in d.messages)
    for message in d.messages:
        found = database.get_message_by_frame_id(message.id)
        assert found.name == message.name
        assert found.senders == [d.nodes[message.sender]]
        assert (found.cycle_time or 0) == message.cycle_ms
        assert (found.comment or "") == message.comment.replace('"', "'")
        for signal in message.signals:
            entry = found.get_signal_by_name(signal.name)
            assert (entry.unit or "") == signal.unit
            said = (entry.comment or "").partition(": bit 0 ")[0] if signal.name == "faults" else entry.comment or ""
            assert said == signal.comment.replace('"', "'")
            assert float(entry.scale) == signal.scale
            choices = {int(k): str(v) for k, v in (entry.choices or {}).items()}
            assert choices == ({v: k for k, v in d.enums[signal.enum].items()} if signal.enum else {})


def test_e2e_agrees_between_c_and_python(firmware: Firmware) -> None:
    ffi, lib = firmware.ffi, firmware.lib
    generator = random.Random(4)
    frame, last = ffi.new("terrapin_frame *"), ffi.new("uint8_t *")
    for counter in range(1000):
        identifier, data = generator.randrange(0x800), generator.randbytes(8)
        frame.id, frame.length, frame.data = identifier, 8, data
        lib.terrapin_e2e_protect(frame, counter)
        assert bytes(frame.data) == protect(identifier, data, counter)
        last[0] = 0xFF
        assert lib.terrapin_e2e_check(frame, last) == lib.TERRAPIN_E2E_OK
        assert last[0] == counter % 15
        assert lib.terrapin_e2e_check(frame, last) == lib.TERRAPIN_E2E_REPEATED
        assert crc8(data) == lib.terrapin_crc8(0, data, len(data))


def test_units_are_units() -> None:
    registry = pint.UnitRegistry()
    d = load()
    for unit in {s.unit for m in d.messages for s in m.signals} | {
        x.unit for x in (*d.parameters, *d.limits, *d.constants, *d.promises)
    }:
        registry.parse_units(unit)


def test_reference_page_names_everything() -> None:
    page = (paths.build() / "generated" / "interface.md").read_text(encoding="utf-8")
    d = load()
    for entry in (*d.messages, *d.parameters, *d.faults, *d.limits, *d.constants, *d.promises):
        assert entry.name in page


def test_reference_page_is_exact() -> None:
    """test_mode_key stood there as 2.11967307e+09, which arms nothing, and a scale with nine digits of its own."""
    d = load()
    page = markdown(d, "cylinder")
    for entry in (*d.limits, *d.constants, *d.promises):
        (value,) = re.findall(rf"^\| `{entry.name}` \| (\S+) \|", page.partition("## Limits")[2], re.MULTILINE)
        assert float(value) == entry.value
        assert "e" not in value or entry.value < 1
    for message in d.messages:
        rows = page.partition(f"### {message.name} (")[2].partition("\n### ")[0]
        for signal in message.signals:
            (scale,) = re.findall(rf"^\| `{signal.name}` \|[^|]*\|[^|]*\| (\S+) \|", rows, re.MULTILINE)
            assert float(scale) == signal.scale


@pytest.mark.parametrize("name", ["sphere", "kr\u00f6te"])
def test_page_and_dbc_say_whose_they_are(name: str, tmp_path: Path) -> None:
    """Two robots' DBCs differed by their scales alone: a log read with the wrong one gave other torques in silence."""
    file = tmp_path / f"{name}.toml"
    shutil.copy(find_robot("sphere"), file)
    generate(CONTROLLER_TOML, [], tmp_path, load_robot(file))
    shown = name.encode("ascii", "replace").decode()
    assert f"Of robot `{shown}`" in (tmp_path / "interface.md").read_text(encoding="utf-8")
    database = cantools.database.load_file(tmp_path / "terrapin.dbc")
    assert f'CM_ "Controller of robot {shown}: ' in (tmp_path / "terrapin.dbc").read_text(encoding="cp1252")
    written = cantools.database.load_string(database.as_dbc_string(), "dbc")
    assert {m.name for m in written.messages} == {m.name for m in load().messages}


def test_no_text_of_the_interface_has_numbers_of_the_cylinder() -> None:
    """Of every robot the page said that its calibration takes 9 m (the sphere's 18), and an sd that was another's."""
    of = {p.name: p for p in load(robot=load_robot(find_robot("sphere"))).parameters}
    for name in ("calibrate_high", "sd_coulomb", "sd_viscous", "sd_current_offset", "sd_current_linearity"):
        assert not re.search(r"\d", of[name].meaning), of[name].meaning


def test_parameters_in_their_units(firmware: Firmware) -> None:
    state = firmware.new_state()
    for parameter in firmware.interface.parameters.values():
        for raw in (parameter.default, parameter.minimum, parameter.maximum):
            firmware.set_parameter(state, parameter.name, raw * parameter.scale)
            assert firmware.get_parameter(state, parameter.name) == raw * parameter.scale
        with pytest.raises(ParameterError, match=f"parameter {parameter.name}: .* is outside"):
            firmware.set_parameter(state, parameter.name, (parameter.maximum + 2) * parameter.scale)
        with pytest.raises(ParameterError, match="is outside"):
            firmware.set_parameter(state, parameter.name, float("nan"))
        assert firmware.get_parameter(state, parameter.name) == parameter.maximum * parameter.scale
        firmware.set_parameter(state, parameter.name, parameter.default * parameter.scale)


def test_defaults_and_bounds_reach_the_c_table(firmware: Firmware) -> None:
    for p in load().parameters:
        entry = firmware.lib.terrapin_parameter(p.index)
        assert (entry.default_value, entry.minimum, entry.maximum) == (p.default, p.minimum, p.maximum)
        assert firmware.lib.terrapin_parameter_protected(p.index) == bool(p.protects)


def test_unknown_parameter_names_the_nearest(firmware: Firmware) -> None:
    name = next(iter(firmware.interface.parameters))
    with pytest.raises(ParameterError, match=f"no parameter '{name}x'.*{name}"):
        firmware.get_parameter(firmware.new_state(), name + "x")


def test_python_encoder_refuses_unknown_signals() -> None:
    with pytest.raises(KeyError, match="message COMMAND has no signal speed"):
        interface().messages["COMMAND"].encode({"speed": 1})
    with pytest.raises(ValueError, match="has 8 bytes, found 3"):
        interface().messages["COMMAND"].decode(b"abc")


# ---------------------------------------------------------------- bad descriptions


@pytest.mark.parametrize(("old", "new", "expected"), PLANTED, ids=[entry[2] for entry in PLANTED])
def test_planted_errors_are_named(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert GOOD.count(old) >= 1
    file = tmp_path / "toy.toml"
    file.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        generate(file, [], tmp_path)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_good_description_is_good() -> None:
    d = parse(GOOD)
    level = d.messages[0].signals[1]
    assert (level.minimum, level.maximum, level.signed, level.scale, level.unit) == (-100, 100, True, 0.5, "V")
    assert (d.messages[0].length, d.messages[1].length) == (8, 6)
    assert [(p.index, p.default) for p in d.parameters] == [(0, 5)]
    assert {f.name: f.latched for f in d.faults} == {"hot": True, "cold": False}


def test_generated_code_of_another_description_compiles_and_clamps(tmp_path: Path) -> None:
    """Ranges narrower than the bits, a 32-bit field across the words: features that the controller may not use."""
    file = tmp_path / "toy.toml"
    file.write_text(GOOD)
    core = paths.ROOT / "firmware" / "core"
    generate(file, [core / "terrapin.h"], tmp_path)
    program = tmp_path / "main.c"
    program.write_text("""
#include "terrapin_interface.h"
int main(void) {
    terrapin_frame f;
    terrapin_one_t one = {.level = 101};
    terrapin_two_t two = {.wide = 0xFEDCBA98U, .tail = 0}, back;
    if (terrapin_encode_one(&one, &f)) return 1;
    if (!terrapin_decode_one(&f, &one) || one.level != 100) return 2;
    one.level = -100;
    if (!terrapin_encode_one(&one, &f)) return 3;
    if (terrapin_encode_two(&two, &f) || f.length != 6) return 4;
    if (!terrapin_decode_two(&f, &back) || back.wide != 0xFEDCBA98U || back.tail != 1) return 5;
    two.tail = 7;
    if (terrapin_encode_two(&two, &f) || !terrapin_decode_two(&f, &back) || back.tail != 6) return 6;
    return terrapin_parameter(TERRAPIN_PARAMETER_GAIN).minimum == -3 && TERRAPIN_FAULTS_LATCHED == 8 ? 0 : 7;
}
""")
    command = ["cc", "-std=c11", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"]
    command += ["-fsanitize=undefined", "-fno-sanitize-recover=all"]
    include = [f"-I{core}", f"-I{tmp_path}"]
    subprocess.run(
        [*command, *include, program, tmp_path / "terrapin_interface.c", "-o", tmp_path / "toy"],
        check=True,
        timeout=300,
    )
    assert subprocess.run([tmp_path / "toy"], timeout=300).returncode == 0


def test_command_line_of_the_generator(tmp_path: Path) -> None:
    """Runs as a plain file with isolated Python, writes nothing twice, and says what is wrong in one line."""
    script = Path(description_module.__file__).with_name("generate.py")
    run = [sys.executable, "-I", str(script), "--out", str(tmp_path)]
    header = paths.ROOT / "firmware" / "core" / "terrapin.h"
    subprocess.run([*run, "--header", str(header)], check=True, timeout=300)
    assert len(list(tmp_path.iterdir())) == 11
    assert generate(CONTROLLER_TOML, [header], tmp_path) == []
    bad = tmp_path / "bad.toml"
    bad.write_text(GOOD.replace("default = 5", "default = 50"))
    failed = subprocess.run([*run, "--description", str(bad)], capture_output=True, text=True, timeout=300)
    assert failed.returncode == 1
    assert failed.stderr == "generate: bad.toml: parameter gain: default 50 is outside -3 to 9\n"


# ---------------------------------------------------------------- what the description states is used

SOURCES = {path: path.read_text(encoding="utf-8") for path in (paths.ROOT / "firmware").rglob("*.[ch]")}
UNUSED = [  # what is added to controller.toml or taken out of the C, and the line that names it
    ("limit", "[limit.ceiling]\nvalue = 3\nmeaning = 'x'", "limit ceiling: no C file names it"),
    ("constant", "[constant.spare]\nvalue = 3\nmeaning = 'x'", "constant spare: no C file names it"),
    ("", ".slip_e4 = s->slip_e4,", "message MOTION, signal slip: no C file fills it"),
    ("", ".trimmed = state->sense.trimmed,", "message STATUS, signal trimmed: no C file fills it"),
    ("", "times.late_250ns =", "message PORT_TIMES, signal late: no C file fills it"),
    ("", "inputs->estop = message.estop != 0;", "message SENSORS_FAST, signal estop: no C file reads it"),
    ("", "(void)message.protocol;", "message UPDATE_QUERY, signal protocol: no C file reads it"),
    ("", "TERRAPIN_LIMIT_ENCODER_JUMP", "limit encoder_jump: no C file names it"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "text", "expected"), UNUSED, ids=[entry[2] for entry in UNUSED])
def test_what_no_code_uses_is_named(kind: str, text: str, expected: str) -> None:
    description = CONTROLLER_TOML.read_text(encoding="utf-8")
    sources = list(SOURCES.values())
    assert unread(parse(description), sources) == []
    if kind:
        description += text + "\n"
    else:
        assert sum(source.count(text) for source in sources) == 1
        sources = [source.replace(text, "") for source in sources]
    assert unread(parse(description), sources) == [expected]


def test_the_build_says_in_one_line_what_no_code_uses(tmp_path: Path) -> None:
    description = tmp_path / "controller.toml"
    description.write_text(CONTROLLER_TOML.read_text(encoding="utf-8") + "[limit.spare]\nvalue = 1\nmeaning = 'x'\n")
    command = [sys.executable, "-I", str(Path(unread_module.__file__)), "--sources", str(paths.ROOT / "firmware")]
    stamp = tmp_path / "stamp"
    done = subprocess.run(
        [*command, "--stamp", str(stamp), "--description", str(description)], capture_output=True, text=True, timeout=30
    )
    assert (done.returncode, done.stderr) == (1, "unread: controller.toml: limit spare: no C file names it\n")
    assert not stamp.exists()
    assert subprocess.run([*command, "--stamp", str(stamp)], timeout=30).returncode == 0
    assert stamp.exists()


@pytest.mark.parametrize("promise", load().promises, ids=lambda promise: promise.name)
def test_each_promise_is_held_by_the_test_that_it_names(promise: Promise) -> None:
    """The test is there, runs, and takes the number from the description."""
    name, function = promise.test.split("::")
    text = (paths.ROOT / name).read_text(encoding="utf-8")
    if name.endswith(".c"):
        assert f"RUN_TEST({function});" in text
        body = re.search(rf"^static void {function}\(void\) \{{.*?^\}}", text, re.DOTALL | re.MULTILINE)
        wanted = f"TERRAPIN_PROMISE_{promise.name.upper()}"
    else:
        body = re.search(rf"^def {function}\(.*?(?=^\S|\Z)", text, re.DOTALL | re.MULTILINE)
        wanted = promise.name
    assert body is not None
    assert wanted in body[0]


def test_physics_and_firmware_mean_the_same_reference_temperature() -> None:
    """The catalogue's formulas carry their number themselves: at the reference they vanish."""
    reference = interface().constants["reference_temperature"]
    named = [effect for effect in catalogue().values() if "temperature" in effect.expression]
    assert len(named) >= 2
    for effect in named:
        values = dict.fromkeys(parse_expression(effect.expression).names, 0.7) | {"temperature": reference}
        assert parse_expression(effect.expression).evaluate(values) == 0.0, effect.name
