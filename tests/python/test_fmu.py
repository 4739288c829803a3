"""FMUs: what is exported is the library and the simulator, bit for bit; what others made moves in the plant's place."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
import zipfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import terrapin_tools as terrapin
from terrapin_hil import robots
from terrapin_hil.firmware import Firmware
from terrapin_hil.fmi.export import export
from terrapin_hil.fmi.plant import FmuPlant
from terrapin_hil.fmi.unit import Block, Unit
from terrapin_hil.fmi.variables import FLAGS, WIRE
from terrapin_hil.links.inprocess import InProcess
from terrapin_hil.paths import SCENARIOS
from terrapin_hil.run.run import run
from terrapin_hil.run.session import chosen_scenario
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_hil.simulation import Simulation

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

STEADY = "steady_sand"
FRAMES = ("frame_1.id", "frame_1.length", "frame_2.id", "frame_2.length")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("fmus")
    scenario = load_scenario(find_scenario(STEADY))
    for kind in ("controller", "plant", "both"):
        export(kind, folder / f"{kind}.fmu", scenario if kind != "controller" else None)
    return {kind: folder / f"{kind}.fmu" for kind in ("controller", "plant", "both")}


@pytest.mark.parametrize("kind", ["controller", "plant", "both"])
def test_fmpys_validator_finds_nothing(made: dict[str, Path], kind: str) -> None:
    assert validate_fmu(str(made[kind])) == []
    with zipfile.ZipFile(made[kind]) as archive:
        names = archive.namelist()
    assert "sources/buildDescription.xml" in names
    assert ("sources/core/step.c" in names) == (kind != "plant")


@pytest.mark.parametrize("kind", ["controller", "plant", "both"])
def test_its_own_sources_have_no_warning(made: dict[str, Path], tmp_path: Path, kind: str) -> None:
    with zipfile.ZipFile(made[kind]) as archive:
        archive.extractall(tmp_path)
    # A kind may have no variable of a type: its count is 0 then.
    strict = ["-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wundef", "-Werror", "-Wno-type-limits"]
    places = [f"-I{folder}" for folder in sorted({path.parent for path in (tmp_path / "sources").rglob("*.h")})]
    done = subprocess.run(
        ["cc", "-std=c11", "-fsyntax-only", *strict, *places, "fmi3.c", "fmu.c"],
        cwd=tmp_path / "sources", capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_a_scenario_on_soil_is_exported_too(tmp_path: Path) -> None:
    """Tables of a contact model stand behind addresses: they are there, and the run is the same."""
    scenario = load_scenario(find_scenario("soft_sand"))
    assert scenario.ground.contact is not None
    export("plant", tmp_path / "plant.fmu", scenario)
    assert validate_fmu(str(tmp_path / "plant.fmu")) == []
    plant = FmuPlant(tmp_path / "plant.fmu")
    assert run(scenario, plant=plant).output_hash == run(scenario).output_hash


class Recorder(InProcess):
    """Keeps the inputs of every step that the link makes."""

    def __init__(self) -> None:
        super().__init__()
        self.inputs: list[bytes] = []

    def _take(self, frame: Any) -> Any:
        before = self._inputs.tick
        answers = super()._take(frame)
        if answers and (self._inputs.tick != before or not self.inputs):
            self.inputs.append(bytes(self._ffi.buffer(self._inputs)))
        return answers


def stepped(scenario: Scenario) -> tuple[list[bytes], Any]:
    """The inputs of every step of a run, and its records."""
    simulation = Simulation(scenario)
    if simulation.disturbed:
        link = Recorder()
        result = run(scenario, link)
        return link.inputs, result.records
    records = run(scenario).records
    return [row.tobytes() for row in records["inputs"][~records["silent"]]], records


WIRES = tuple(WIRE)
FLAG = tuple(FLAGS)


def field(inputs: Any, name: str) -> int:
    part: Any = inputs.command if name in ("request", "control", "setpoint", "limiter") else inputs
    return 0 if name == "silent" else int(getattr(part, name))


def test_the_controller_is_the_library_over_every_scenario(made: dict[str, Path]) -> None:
    firmware = Firmware.open()
    outputs = firmware.ffi.new("terrapin_outputs *")
    names = [path.stem for path in sorted(SCENARIOS.glob("*.toml"))]
    assert len(names) >= 40
    ticks = 0
    for name in names:
        scenario = load_scenario(find_scenario(name))
        rows, records = stepped(scenario)
        state = firmware.new_state()
        for parameter, value in scenario.firmware.items():
            firmware.set_parameter(state, parameter, value)
        with Unit(made["controller"]) as unit:
            unit.start(scenario.firmware)
            unit.within(600, partial(compare, unit, rows, firmware, state, outputs, name))
        ticks += len(rows)
        if not Simulation(scenario).disturbed:  # what the library does in this loop is what the run did
            assert bytes(outputs.frames[0].data) == bytes(records["answer"][~records["silent"]][-1][0]["data"]), name
    assert ticks > 400_000


def compare(unit: Unit, rows: list[bytes], firmware: Firmware, state: Any, outputs: Any, name: str) -> None:
    """Both make the same steps; `outputs` is that of the last one."""
    inputs = firmware.ffi.new("terrapin_inputs *")
    wires, flags = Block(unit, WIRES, True), Block(unit, FLAG, True)
    numbers = ["duty_q15", "frame_count", "frame_1.id", "frame_2.id", "frame_1.length", "frame_2.length"]
    said, bits = Block(unit, numbers, False), Block(unit, ["faults", "frame_1.data", "frame_2.data"], False)
    enable = Block(unit, ["enable"], False)
    for tick, row in enumerate(rows):
        firmware.ffi.memmove(inputs, row, len(row))
        firmware.lib.terrapin_step(state, inputs, outputs)
        for i, wire in enumerate(WIRES):
            wires.values[i] = field(inputs, wire)
        for i, flag in enumerate(FLAG):
            flags.values[i] = bool(field(inputs, flag))
        wires()
        flags()
        unit.step(1, tick)
        count = outputs.frame_count
        frames = [outputs.frames[i] if i < count else None for i in range(2)]
        expected = [outputs.duty_q15, count]
        expected += [frame.id if frame else -1 for frame in frames] + [frame.length if frame else 0 for frame in frames]
        data = [int.from_bytes(bytes(frame.data[0 : frame.length]), "little") if frame else 0 for frame in frames]
        found = [list(said()), list(bits()), enable()[0]]
        assert found == [expected, [outputs.faults, *data], outputs.enable], f"{name}: tick {tick}"


def opened(path: Path, folder: Path) -> Any:
    """An FMU as FMPy opens it, initialised, and the value reference of each name."""
    where = fmpy.extract(str(path), unzipdir=str(folder))
    description = fmpy.read_model_description(where)
    unit = FMU3Slave(
        guid=description.guid, unzipDirectory=where, modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )  # fmt: skip
    unit.instantiate()
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    return unit, {v.name: v.valueReference for v in description.modelVariables}


def test_two_fmus_side_by_side_in_fmpy_give_the_hash_of_the_run(made: dict[str, Path], tmp_path: Path) -> None:
    """At 1 ms, the controller before the plant in each step; at least twice as fast as real time (issue's bound)."""
    whole = run(load_scenario(find_scenario(STEADY)))
    plant, of_plant = opened(made["plant"], tmp_path / "p")
    controller, of_controller = opened(made["controller"], tmp_path / "c")
    wires, flags = [of_plant[n] for n in WIRES], [of_plant[n] for n in FLAG]
    to_wires, to_flags = [of_controller[n] for n in WIRES], [of_controller[n] for n in FLAG]
    numbers = [of_controller[n] for n in ("duty_q15", "frame_count", *FRAMES)]
    data, enable = [of_controller["frame_1.data"], of_controller["frame_2.data"]], [of_controller["enable"]]
    to_duty, to_enable = [of_plant["duty_q15"]], [of_plant["enable"]]
    digest, began = hashlib.sha256(), time.process_time()
    for tick in range(len(whole.records)):
        controller.setInt32(to_wires, plant.getInt32(wires))
        controller.setBoolean(to_flags, plant.getBoolean(flags))
        controller.doStep(tick * 1e-3, 1e-3)
        duty, count, *frames = controller.getInt32(numbers)
        plant.setInt32(to_duty, [duty])
        plant.setBoolean(to_enable, controller.getBoolean(enable))
        plant.doStep(tick * 1e-3, 1e-3)
        for i, word in zip(range(count), controller.getUInt64(data), strict=False):
            identifier, length = frames[2 * i : 2 * i + 2]
            digest.update(identifier.to_bytes(2, "little") + bytes([length]) + word.to_bytes(8, "little")[:length])
    took = time.process_time() - began
    truth = plant.getFloat64([of_plant["contact_torque"], of_plant["omega"], of_plant["position"]])
    for unit in (plant, controller):
        unit.terminate()
        unit.freeInstance()
    assert digest.hexdigest() == whole.output_hash
    kept = {name: values[-1] for name, values in whole.truth.items()}  # a tick before the FMU's
    assert abs(truth[0] - kept["contact_torque"]) < 1e-3
    assert took < whole.scenario.duration / 2, f"{took:.2f} s of the processor"


def test_both_in_one_at_ten_milliseconds(made: dict[str, Path]) -> None:
    """FMPy's own simulation, the simulator's truth within 1e-9, 20 times real time (the bounds)."""
    whole = run(load_scenario(find_scenario(STEADY)))
    began = time.process_time()
    names = ["contact_torque", "omega", "position", "slip", "current", "GROUND.torque", "STATUS.state"]
    found = fmpy.simulate_fmu(
        str(made["both"]), stop_time=10.0, output_interval=0.01, step_size=0.01, output=names, validate=False
    )
    took = time.process_time() - began
    assert len(found) == 1001
    for name in names[:5]:
        expected = whole.truth[name][::10]
        assert np.max(np.abs(found[name][: len(expected)] - expected)) <= 1e-9, name
    assert found["GROUND.torque"][-2] == whole.held("GROUND", "torque")[9989]
    assert took < 0.5, f"{took:.2f} s of the processor"


def test_the_sphere_in_one_is_its_run(tmp_path: Path) -> None:
    """By the command; then FMPy's own simulation, the simulator's truth within 1e-9."""
    done = command("fmu", "export", "both", "--robot", "sphere", "--scenario", "level", "-o", tmp_path / "sphere.fmu")
    assert done.returncode == 0, done.stderr
    assert validate_fmu(str(tmp_path / "sphere.fmu")) == []
    names = ["omega", "position", "swing_angle", "contact_torque", "current"]
    found = fmpy.simulate_fmu(
        str(tmp_path / "sphere.fmu"), stop_time=10.0, output_interval=0.01, step_size=0.01, output=names
    )
    try:
        truth = run(chosen_scenario("level", "sphere")).truth
    finally:
        robots.select(robots.DEFAULT)
    assert np.max(np.abs(truth["swing_angle"])) > 0.05
    for name in names:
        expected = truth[name][:10_000:10]
        assert len(expected) == 1000
        assert np.max(np.abs(found[name][:1000] - expected)) <= 1e-9, name


def test_our_plant_imported_again_gives_the_same_hash(made: dict[str, Path]) -> None:
    scenario = load_scenario(find_scenario(STEADY))
    whole = run(scenario)
    plant = FmuPlant(made["plant"])
    again = run(scenario, plant=plant)
    plant.close()
    assert again.output_hash == whole.output_hash
    for name in ("position", "omega", "current", "contact_torque", "slip"):
        assert np.max(np.abs(again.truth[name] - whole.truth[name])) <= 1e-9, name


def test_a_value_out_of_range_is_named(made: dict[str, Path], capfd: pytest.CaptureFixture[str]) -> None:
    """With what was given and what is taken: a host that sets fifty of them says no more than that one failed."""
    values = {"weight": 30.0, "radius": 99.0}
    with pytest.raises(fmpy.fmi1.FMICallException):
        fmpy.simulate_fmu(str(made["both"]), stop_time=0.1, step_size=0.01, output_interval=0.01, start_values=values)
    reference = next(
        v.valueReference for v in fmpy.read_model_description(str(made["both"])).modelVariables if v.name == "radius"
    )
    assert f"value reference {reference}: found 99, expected 0.01 to 0.5" in capfd.readouterr().out


def test_its_state_goes_back(made: dict[str, Path]) -> None:
    with terrapin.Session(STEADY, plant=made["plant"]) as s:
        s.step(2.0)
        kept = s.checkpoint()
        first = s.step(0.5).signals
        assert s.restore(kept).step(0.5).signals == first


def test_the_state_is_serialised(made: dict[str, Path], tmp_path: Path) -> None:
    """FMPy's bytes of a state, in another instance: it goes on the same."""
    unit, of = opened(made["both"], tmp_path / "a")
    other, _ = opened(made["both"], tmp_path / "b")
    unit.doStep(0.0, 3.0)
    state = unit.getFMUState()
    there = other.deserializeFMUState(unit.serializeFMUState(state))
    other.setFMUState(there)
    names = [of[n] for n in ("omega", "current", "contact_torque", "GROUND.torque")]
    for one in (unit, other):
        one.doStep(3.0, 1.0)
    assert unit.getFloat64(names) == other.getFloat64(names)
    assert unit.getFloat64(names)[0] > 1.0


# -- FMUs of others ----------------------------------------------------------------------------------------------------

MOTOR = """
import time

from pythonfmu3 import Boolean, Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64

INPUT, OUTPUT, DISCRETE = Fmi3Causality.input, Fmi3Causality.output, Fmi3Variability.discrete


class Motor(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = self.{voltage} = self.omega = self.speed = self.current = 0.0
        self.enabled = False
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous)
        )
        self.register_variable(Float64("{voltage}", causality=INPUT, start=0.0))
        self.register_variable(Boolean("enabled", causality=INPUT, variability=DISCRETE, start=False))
        for name in ("omega", "speed", "current"):
            self.register_variable(Float64(name, causality=OUTPUT))

    def do_step(self, current_time, step_size):
        {late}
        self.current = (self.{voltage} - 0.444 * self.omega) / 4.0 if self.enabled else 0.0
        self.omega = max(0.0, self.omega + step_size * (0.444 * self.current - 0.12) / 0.05)
        self.speed = 0.08 * self.omega
        return True
"""


def motor(folder: Path, voltage: str = "voltage", late: str = "pass") -> Path:
    pytest.importorskip("pythonfmu3")
    (folder / "motor.py").write_text(MOTOR.format(voltage=voltage, late=late), encoding="utf-8")
    command = [sys.executable, "-m", "pythonfmu3", "build", "-f", "motor.py"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "Motor.fmu"


def command(*words: object) -> subprocess.CompletedProcess[str]:
    program = "from terrapin_tools.cli import main; main()"
    call = [sys.executable, "-c", program, *map(str, words)]
    return subprocess.run(call, capture_output=True, text=True, check=False, timeout=120)


def test_one_of_pythonfmu3_drives_ten_seconds_in_lockstep(tmp_path: Path) -> None:
    """It moves as the same equations in Python do as a session's plant."""
    omega, current = 0.0, 0.0

    def same(voltage: float | None) -> dict[str, float]:
        nonlocal omega, current
        current = 0.0 if voltage is None else (voltage - 0.444 * omega) / 4.0
        omega = max(0.0, omega + 1e-3 * (0.444 * current - 0.12) / 0.05)
        return {"omega": omega, "speed": 0.08 * omega, "current": current}

    with terrapin.Session(STEADY, plant=same) as s:
        expected = s.step(10.0).signals
    done = command("run", STEADY, "--plant", motor(tmp_path), "--out", tmp_path / "log")
    assert "10 s in" in done.stdout, done.stderr
    log = terrapin.Log(tmp_path / "log")
    assert log["MOTION.shell_speed"]["MOTION.shell_speed"].to_pylist()[-1] == expected["MOTION.shell_speed"] > 5.0


def test_one_that_lacks_an_input_is_refused_with_the_reason(tmp_path: Path) -> None:
    file = motor(tmp_path, voltage="u")
    done = command("run", STEADY, "--plant", file)
    assert done.returncode == 2
    assert done.stderr == f"terrapin: {file}: found the inputs enabled, u; expected voltage or duty_q15\n"
    done = command("run", STEADY, "--plant", file, "--plant-name", "voltage=u")
    assert "10 s in" in done.stdout, done.stderr


def test_one_that_answers_late_ends_the_run_with_a_line(tmp_path: Path) -> None:
    file = motor(tmp_path, late="time.sleep(60.0 if current_time > 0.5 else 0.0)")
    began = time.monotonic()
    done = command("run", STEADY, "--plant", file)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == f"terrapin: {file}: no answer within 2 s"
    assert time.monotonic() - began < 40


def test_one_that_fails_says_so(tmp_path: Path) -> None:
    file = motor(tmp_path, late="assert current_time < 0.5")
    done = command("run", STEADY, "--plant", file)
    assert done.returncode == 1
    assert f"terrapin: {file}: " in done.stderr.splitlines()[-1]
