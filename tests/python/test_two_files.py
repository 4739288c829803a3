"""A new telemetry signal, message or fault is two files: added to a copy of the sources, which is then built."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from terrapin_hil import paths

TARGETS = ("terrapin", "terrapin_hil", "unread")
TOML = "firmware/terrapin_interface/controller.toml"
Edits = dict[str, Sequence[tuple[str, str]]]  # file -> pairs of (what stands there, what is added behind it)

SIGNAL: Edits = {
    TOML: [
        (
            'largest slip since the request, rolling back not counted" },\n',
            '  { name = "motor_torque", start = 53, length = 11, signed = true, scale = 0.001, unit = "N m", '
            'source = "motor_unm" },\n',
        )
    ],
    "firmware/core/telemetry.c": [
        ("        .peak_e4 = state->slip.peak_e4,\n", "        .motor_unm = state->estimator.motor_unm,\n")
    ],
}
# 64 bits of its own in the slot that HEADING leaves free: each round, or every second one where HEADING is sent.
MESSAGE: Edits = {
    TOML: [
        (
            'source = "y_um" },\n]\n',
            """
[message.DRIVE]
id = 0x18B
sender = "controller"
cycle_ms = 10
comment = "Slot 9, every second round where HEADING is sent."
signals = [
  { name = "motor", start = 0, length = 32, signed = true, scale = 0.000001, unit = "N m", source = "motor_unm" },
  { name = "supply", start = 32, length = 32, signed = true, scale = 0.001, unit = "V", source = "supply_mv" },
]
""",
        )
    ],
    "firmware/core/telemetry.c": [
        (
            "    return terrapin_pack_heading(&message, frame);\n}\n",
            """
static bool drive(const terrapin_state *state, terrapin_frame *frame) {
    const terrapin_drive_source source = {
        .motor_unm = state->estimator.motor_unm,
        .supply_mv = sense_supply_mv(state),
    };
    const terrapin_drive_t message = terrapin_scale_drive(&source);
    return terrapin_pack_drive(&message, frame);
}
""",
        ),
        ("    default:\n        sent = state->heading.known", " && (((inputs->tick / (uint32_t)SLOT_MS) % 2U) != 0U)"),
        (
            "            *fits = heading(state, frame);\n        }",
            " else {\n            sent = true;\n            *fits = drive(state, frame);\n        }",
        ),
    ],
}
FAULT: Edits = {
    TOML: [
        (
            'scenarios = ["link_silence", "missed_tick"]\n',
            """
[fault.current_rail]
number = 20
cause = "current code at the upper end of its range"
reaction = "flag only; goes with its cause"
within_ms = 1
latched = false
scenarios = ["current_sensor_stuck"]
""",
        )
    ],
    "firmware/core/sense.c": [
        (
            "    uint32_t causes = watch(state, inputs);\n",
            "    if (inputs->current_code >= (uint16_t)CODE_HIGH) {\n"
            "        causes |= fault_bit(TERRAPIN_FAULT_CURRENT_RAIL);\n    }\n",
        )
    ],
}

# What goes in is the whole program, run against the copy's build in a process of its own.
SEE_SIGNAL = """
import cantools
from terrapin_hil import paths
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
result = run(load_scenario(find_scenario("steady_sand")))
seen = result.held("REPORT", "motor_torque")[-2000:]
torque = result.held("GROUND", "torque")[-2000:]
coulomb, viscous = (result.held("CALIBRATION", name)[-2000:] for name in ("coulomb", "viscous"))
friction = coulomb + viscous * result.held("WINDOW", "omega")[-2000:]
assert 0.1 < seen.mean() < 1.0, seen.mean()
assert abs(seen - torque - friction).max() < 0.003
database = cantools.database.load_file(paths.dbc())
message = database.get_message_by_name("REPORT")
sent = result.records["answer"]
frames = sent[sent["id"] == message.frame_id]
values = result.telemetry["REPORT"]["motor_torque"]
assert len(frames) == len(values) > 100
for frame, value in zip(frames[-100:], values[-100:], strict=True):
    assert abs(message.decode(bytes(frame["data"]))["motor_torque"] - value) < 1e-9
print("seen")
"""
DRIVES = """
duration = 8
seed = 1
[[path]]
terrain = "agricultural"
[[operator]]
at = 0.2
request = "run"
setpoint = "5 V"
"""
STEERED = """steering = [[0, "0 deg"], [8, "90 deg"]]""" + DRIVES
SEE_MESSAGE = (
    f"SCENARIOS = {DRIVES!r}, {STEERED!r}"
    + """
from pathlib import Path
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import load_scenario
for text, shared in zip(SCENARIOS, (False, True)):
    Path("drives.toml").write_text(text)
    result = run(load_scenario(Path("drives.toml")))
    said = {name: len(table["time"]) for name, table in result.telemetry.items()}
    rounds, own, heading = said["STATUS"], said["DRIVE"], said.get("HEADING", 0)
    assert rounds > 700 and abs(own - (rounds / 2 if shared else rounds)) <= 2, (text, own, rounds)
    assert own + heading <= rounds + 1 and (heading > 300) == shared, (text, heading)
    last = {name: result.held(*name.split("."))[-1000:] for name in ("DRIVE.supply", "ELECTRICAL.supply", "DRIVE.motor",
            "GROUND.torque", "CALIBRATION.coulomb", "CALIBRATION.viscous", "WINDOW.omega")}
    assert abs(last["DRIVE.supply"] - last["ELECTRICAL.supply"]).max() < 0.1
    friction = last["CALIBRATION.coulomb"] + last["CALIBRATION.viscous"] * last["WINDOW.omega"]
    assert abs(last["DRIVE.motor"] - last["GROUND.torque"] - friction).max() < 0.003
print("seen")
"""
)
SEE_FAULT = """
from terrapin_hil.run.run import run
from terrapin_hil.scenario.scenario import find_scenario, load_scenario
result = run(load_scenario(find_scenario("current_sensor_stuck")))
bad = [f"{o.text}: {o.found}" for o in result.outcomes if not o.passed]
assert not bad, bad
own = [o.text for o in result.outcomes if o.text.startswith("current_rail: ")]
assert len(own) == 2, own
assert result.interface.faults["current_rail"] == 20
print("seen")
"""


def scratch(folder: Path) -> Callable[[Edits | None, str], subprocess.CompletedProcess[str]]:
    """A copy of what the controller and the simulator are built from; a function that edits, builds and runs a text."""
    for name in ("firmware", "hil", "tests"):
        ignored = shutil.ignore_patterns("__pycache__", "build")
        shutil.copytree(paths.ROOT / name, folder / name, ignore=ignored)
    for name in ("CMakeLists.txt", "CMakePresets.json", "pyproject.toml"):
        shutil.copy(paths.ROOT / name, folder / name)
    python = f"-DPython3_EXECUTABLE={sys.executable}"

    def attempt(edits: Edits | None, program: str) -> subprocess.CompletedProcess[str]:
        for name, pairs in (edits or {}).items():
            text = (paths.ROOT / name).read_text(encoding="utf-8")
            for before, addition in pairs:
                assert text.count(before) == 1, (name, before)
                text = text.replace(before, before + addition)
            (folder / name).write_text(text, encoding="utf-8")
        subprocess.run(["cmake", "--preset", "host", python], cwd=folder, check=True, capture_output=True, timeout=300)
        build = ["cmake", "--build", "--preset", "host", "--target", *TARGETS]
        built = subprocess.run(build, cwd=folder, check=False, capture_output=True, text=True, timeout=900)
        for name in edits or {}:
            shutil.copy(paths.ROOT / name, folder / name)
        if built.returncode != 0:
            return built
        environment = {
            **os.environ,
            "TERRAPIN_BUILD": str(folder / "build" / "host"),
            "PYTHONPATH": os.pathsep.join(str(folder / name) for name in ("firmware", "hil")),
        }
        command = [sys.executable, "-c", program]
        return subprocess.run(
            command, cwd=folder, env=environment, check=False, capture_output=True, text=True, timeout=300
        )

    return attempt


@pytest.fixture(scope="module")
def attempt(
    tmp_path_factory: pytest.TempPathFactory,
) -> Callable[[Edits | None, str], subprocess.CompletedProcess[str]]:
    return scratch(tmp_path_factory.mktemp("sources"))


@pytest.mark.parametrize(
    ("edits", "program"),
    [(SIGNAL, SEE_SIGNAL), (MESSAGE, SEE_MESSAGE), (FAULT, SEE_FAULT)],
    ids=["signal", "message", "fault"],
)
def test_two_files_are_all(attempt, edits: Edits, program: str) -> None:
    assert len(edits) <= 2
    done = attempt(edits, program)
    assert done.stdout.strip().endswith("seen"), (done.stdout + done.stderr)[-2000:]


def test_a_signal_that_nobody_fills_stops_the_build(attempt) -> None:
    built = attempt({TOML: SIGNAL[TOML]}, "")
    assert built.returncode != 0
    assert (
        "unread: controller.toml: message REPORT, signal motor_torque: no C file fills it"
        in built.stdout + built.stderr
    )
