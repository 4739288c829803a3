"""A robot's file from a data sheet: what follows from what, what contradicts itself, the questions at a terminal."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from terrapin_interface.description import load
from terrapin_interface.robot import load_robot, read_robot
from terrapin_tools.commands import robot as command
from terrapin_tools.errors import UserError
from terrapin_tools.sheet.asking import asked
from terrapin_tools.sheet.figures import FIGURES, read
from terrapin_tools.sheet.motor import motor_of
from terrapin_tools.sheet.proposal import robot_text
from terrapin_tools.sheet.suiting import suiting_text
from tests.drives import DRIVES

RE30 = {**DRIVES["maxon_re30"].robot, **DRIVES["maxon_re30"].sheet}
POLOLU = {**DRIVES["pololu_37d_30"].robot, **DRIVES["pololu_37d_30"].sheet}


def test_the_motors_constants_are_those_of_the_sheet() -> None:
    motor = motor_of(read(RE30))
    assert (motor.torque_constant, motor.resistance) == (pytest.approx(0.0259), 0.611)
    speed_only = {name: text for name, text in RE30.items() if name not in ("torque_constant", "kv", "resistance")}
    motor = motor_of(read(speed_only))
    assert motor.resistance == pytest.approx(24.0 / 39.3)
    assert motor.torque_constant == pytest.approx((24.0 - 24.0 / 39.3 * 0.164) / (8810 * 0.104719755))


@pytest.mark.parametrize(
    ("name", "text"),
    [("kv", "369 1/min/V"), ("kv", "369 min^-1/V"), ("kv", "369 min-1/V"), ("no_load_speed", "8810 1/min")],
)
def test_a_minutes_turns_are_rpm(name: str, text: str) -> None:
    """As German sheets print them."""
    rpm = text.replace("1/min", "rpm").replace("min^-1", "rpm").replace("min-1", "rpm")
    assert read({**RE30, name: text}) == read({**RE30, name: rpm})
    assert read({**RE30, name: text})[name] == pytest.approx(float(text.split()[0]) * 2.0 * math.pi / 60.0)
    with pytest.raises(UserError, match=rf"^--{name.replace('_', '-')}: found '3 1/min/s', expected a number in rad"):
        read({**RE30, name: "3 1/min/s"})


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("gear", "21:1", 21.0),
        ("gear", "20.4 : 1", 20.4),
        ("gear_efficiency", "81 %", 0.81),
        ("gear_efficiency", "72.5%", 0.725),
    ],
)
def test_a_ratio_and_a_percentage_are_read_as_sheets_print_them(name: str, text: str, value: float) -> None:
    assert read({**RE30, name: text})[name] == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        *(("gear", text) for text in ("21:2", "1:21", "21:1:1", ":1", "21 %", "21:", "x:1")),
        *(("gear_efficiency", text) for text in ("%", "81 %%", "% 81", "0.8:1", "eighty %")),
        *(("encoder_counts", text) for text in ("2000:1", "2000 %")),
    ],
)
def test_what_is_no_ratio_and_no_percentage_is_refused_as_it_was_written(name: str, text: str) -> None:
    expected = f"^--{name.replace('_', '-')}: found {re.escape(repr(text))}, expected a number: [^\\n]*$"
    with pytest.raises(UserError, match=expected):
        read({**RE30, name: text})


def test_more_than_all_is_no_share() -> None:
    with pytest.raises(UserError, match=r"^--gear-efficiency: found 1\.2, expected more than 0, at most 1$"):
        robot_text("robot", read({**RE30, "gear_efficiency": "120 %"}))


@pytest.mark.parametrize("supply", [12, 16, 18, 22, 30, 36, 48])
def test_every_usual_supply_is_taken(supply: int, tmp_path: Path) -> None:
    """A part's rating is a fifth above 85 % of it, which may be beyond the full scale; it then narrows nothing."""
    given = {**RE30, "supply": f"{supply} V", "sheet_voltage": "24 V"}
    text = suiting_text(tmp_path / "mine.toml", read(given))
    found = load(robot=read_robot(text, tmp_path / "mine.toml"))
    limit = next(p for p in found.parameters if p.name == "voltage_limit")
    assert limit.default == pytest.approx(min(850 * supply, 32000), abs=60)
    assert limit.maximum == min(round(1.2 * limit.default), 16000 if limit.default <= 16000 else 32000)


def test_what_a_sheet_says_at_the_output_goes_through_the_gear() -> None:
    """330 rpm behind 30:1 are 9900 rpm of the motor; its torque at stall shows what the gear loses."""
    motor = motor_of(read(POLOLU))
    assert motor.torque_constant == pytest.approx((12.0 - 12.0 / 5.5 * 0.2) / (9900 * 0.104719755))
    assert motor.efficiency == pytest.approx(14 * 0.0980665 / 5.3 / 30 / motor.torque_constant)


def test_an_encoder_behind_the_gear_makes_motor_and_gear_one() -> None:
    drive = DRIVES["dynamixel_ax12a"]
    robot = read_robot(robot_text("servo", read({**drive.robot, **drive.sheet})), Path("servo.toml"))
    assert robot.counts == 4096
    assert robot.plant["torque_constant"] == pytest.approx((12.0 - 8.0 * 0.075) / (59 * 0.104719755))


@pytest.mark.parametrize(
    ("sheet", "changes", "words"),
    [
        (
            RE30,
            {"kv": "300 rpm/V"},
            r"^--kv: found 0\.03183 N m/A, .*expected 0\.0259 N m/A within 15%.*--torque-constant",
        ),
        (RE30, {"stall_current": "30 A"}, r"^--stall-current: found 0\.8 ohm, .*expected 0\.611 ohm.*--resistance"),
        (RE30, {"no_load_speed": "7000 rpm"}, r"^--no-load-speed: found 0\.0326.*expected 0\.0259 N m/A"),
        (RE30, {"stall_torque": "0.7 N m"}, r"^--stall-torque: found 0\.0178.*expected 0\.0259 N m/A"),
        (RE30, {"no_load_current": "25 A"}, r"^--no-load-current: found 25 A, expected less than half of the 39\.28 A"),
        (RE30, {"gear_efficiency": "1.2"}, r"^--gear-efficiency: found 1\.2, expected more than 0, at most 1$"),
        (RE30, {"gear": "0.2"}, r"^--gear: found 0\.2, with which rolling on sand takes .* expected a stronger motor"),
        (
            RE30,
            {"gear": "140"},
            r"^--gear: found 140, with which the inner body follows its motor within .* expected 10 ms",
        ),
        (
            RE30,
            {"drive_radius": "160 mm"},
            r"^--drive-radius: found 0\.16 m, expected less than the 0\.15 m of --radius",
        ),
        (
            POLOLU,
            {"stall_torque": "40 kgf cm"},
            r"^--stall-torque: found 3\.923 N m, expected 0\.532 to 2\.04 N m at 5\.5 A",
        ),
        (POLOLU, {"gear_efficiency": "0.3"}, r"^--gear-efficiency: found 0\.3, expected 0\.77 within 0\.25"),
        (POLOLU, {"no_load_speed": ""}, r"^--kv is missing, expected it, --torque-constant, or --no-load-speed"),
        (POLOLU, {"stall_current": ""}, r"^--resistance is missing, expected it or --stall-current"),
        (POLOLU, {"radius": "", "supply": ""}, r"^--radius is missing, expected R, of the shell, .*; so are --supply$"),
        (POLOLU, {"radius": "0.11"}, r"^--radius: found '0\.11', expected a number in m or a text with a unit"),
        (POLOLU, {"kind": "cube"}, r"^--kind: found 'cube', expected one of cylinder, sphere"),
        (POLOLU, {"gear": "-30"}, r"^--gear: found '-30', expected more than 0"),
    ],
)
def test_a_sheet_that_contradicts_itself_is_refused_in_one_line(
    sheet: dict[str, str], changes: dict[str, str], words: str
) -> None:
    with pytest.raises(UserError, match=words) as found:
        robot_text("robot", read({**sheet, **changes}))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    ("name", "changes", "advised"),
    [
        ("maxon_re30", {"gear": "0.2"}, ["gear"]),
        ("maxon_re30", {"gear": "30"}, ["gear", "drive_radius"]),  # the rotor is most of the inertia: no factor helps
        ("maxon_re30", {"gear": "3000"}, ["gear"]),
        ("maxon_re30", {"gear": "300", "encoder_counts": "48"}, ["gear"]),  # too coarse for every gear that suits
        ("maxon_ec45_flat_70", {"gear": "300"}, ["gear"]),
        ("maxon_ec45_flat_70", {"encoder_counts": "500"}, []),  # a sphere's counts are not geared
        ("pololu_37d_30", {"arm": "10 mm"}, ["drive_radius"]),  # its sheet has the gear
        ("tmotor_u8", {"gear": "30"}, ["gear"]),
        ("tmotor_u8", {"gear": "0.2"}, ["gear"]),
    ],
)
def test_what_a_refused_gear_is_told_is_taken(
    name: str, changes: dict[str, str], advised: list[str], tmp_path: Path
) -> None:
    """The numbers of the message, typed as they stand there, with what it says beside them."""
    drive = DRIVES[name]
    given, file = {**drive.robot, **drive.sheet, **changes}, tmp_path / "mine.toml"
    with pytest.raises(UserError) as refused:
        suiting_text(file, read(given))
    advice = str(refused.value).partition(", expected ")[2]
    found = re.findall(r"--([a-z-]+) ([\d.]+(?: m)?)(?: to ([\d.]+(?: m)?))?(?: with --encoder-counts (\d+))?", advice)
    assert [option.replace("-", "_") for option, *_ in found] == advised, advice
    for option, low, high, counts in found:
        beside = {"encoder_counts": counts} if counts else {}
        for value in filter(None, (low, high)):
            assert suiting_text(file, read({**given, option.replace("-", "_"): value, **beside}))
    encoder = re.search(r"an encoder of (\d+) counts", advice)
    if encoder:
        assert suiting_text(file, read({**given, "encoder_counts": encoder[1]}))


@pytest.mark.parametrize("name", DRIVES)
def test_every_value_says_from_what(name: str) -> None:
    drive = DRIVES[name]
    text = robot_text(name, read({**drive.robot, **drive.sheet}))
    robot = read_robot(text, Path(f"{name}.toml"))
    for line in text.splitlines()[3:]:
        assert not line or re.fullmatch(r"\[[a-z_.]+\]|\S+ = .+ # \S.*", line), line
    assert robot.limits["current"] < robot.limits["over_current"]


@pytest.mark.parametrize("name", DRIVES)
def test_the_gear_has_its_loss_and_the_motor_its_current_without_load(name: str) -> None:
    """What the gear loses goes with the load: it is no dry friction of a robot without load."""
    drive = DRIVES[name]
    figures = read({**drive.robot, **drive.sheet})
    motor, robot = motor_of(figures), read_robot(robot_text(name, figures), Path(f"{name}.toml"))
    assert robot.plant["gear_efficiency"] == pytest.approx(motor.efficiency, abs=5e-4)
    ampere = robot.wheel_gear * robot.plant["torque_constant"]
    speed = (robot.supply - motor.resistance * motor.no_load_current) / ampere
    friction = robot.plant["coulomb"] + robot.plant["viscous"] * speed
    assert friction / (ampere * motor.efficiency) == pytest.approx(motor.no_load_current, rel=1e-3)


@pytest.mark.parametrize("name", ["pololu_37d_30", "pololu_37d_19", "maxon_ec45_flat_30", "maxon_re40"])
def test_a_robots_speed_without_load_is_the_sheets(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The speed of the motor without friction is above it, and is told as such. Sheets that name several figures agree
    within some percent."""
    drive = DRIVES[name]
    figures = read({**drive.robot, **drive.sheet})
    robot = read_robot(robot_text(name, figures), Path(f"{name}.toml"))
    behind = 1.0 if figures["at"] == "output" else float(figures["gear"])
    exact = "kv" not in figures and "torque_constant" not in figures
    sheet = float(figures["no_load_speed"]) / behind
    assert robot.idle_speed == pytest.approx(sheet, rel=1e-3 if exact else 0.04)
    assert robot.idle_speed < robot.free_speed
    command.show("roller")
    assert "77.01 rad/s without load (79.01 without friction)" in capsys.readouterr().out


def test_the_command_writes_a_file_or_nothing(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    words = ["new", str(file), "--from-sheet", *DRIVES["pololu_37d_30"].words]
    runner = CliRunner()
    application = _application()
    assert isinstance(runner.invoke(application, [*words, "--stall-torque", "40 kgf cm"]).exception, UserError)
    assert not file.exists()
    done = runner.invoke(application, words)
    assert done.exit_code == 0, done.output
    assert load_robot(file).counts == 1920
    assert isinstance(runner.invoke(application, words).exception, UserError)  # it is there already
    other = str(tmp_path / "other.toml")
    for wrong in (["new", other, "--kv", "100 rpm/V"], ["new", other, "--from-sheet", "--like", "roller"]):
        assert isinstance(runner.invoke(application, wrong).exception, UserError)


def _application() -> object:
    import typer

    application = typer.Typer()
    for subcommand in command.SUBCOMMANDS:
        application.command(subcommand.__name__.strip("_"))(subcommand)
    return application


def test_it_asks_for_what_is_not_given() -> None:
    """Each figure once; what is wrong or needed is asked again, and after three tries told."""
    given = {name: text for name, text in POLOLU.items() if name not in ("supply", "gear", "shell_mass")}
    asked_for: list[str] = []
    answers = {"supply": ["12 pears", "12 V"], "gear": ["30"], "shell mass": ["", "0.55 kg"]}

    def answer(question: str) -> str:
        name = question.partition(",")[0]
        asked_for.append(name)
        return answers[name].pop(0) if answers.get(name) else ""

    told: list[str] = []
    found = asked(given, answer, told.append)
    assert robot_text("robot", read(found)) == robot_text("robot", read(POLOLU))
    assert asked_for.count("supply") == asked_for.count("shell mass") == 2
    assert "radius" not in asked_for
    assert "frame mass" not in asked_for
    assert any("--supply: found '12 pears'" in line for line in told)
    with pytest.raises(UserError, match=r"^radius: no answer that can be used after 3 tries$"):
        asked({}, lambda _: "", told.append)


def test_every_figure_is_an_option() -> None:
    shown = CliRunner().invoke(_application(), ["new", "--help"], env={"COLUMNS": "200"}).output
    assert all(f"--{name.replace('_', '-')} " in shown for name in FIGURES)
