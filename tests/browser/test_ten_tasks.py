"""Ten tasks of a new user, each begun from the first screen and done in at most eight actions."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from random import Random

import pytest
from playwright.sync_api import Locator, Page, expect
from serving import Server

MOST = 8


class Hand:
    """What a user does on the page: each call is one action. Looking and waiting are none."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.actions = 0

    def click(self, what: Locator) -> None:
        self.actions += 1
        what.click()

    def button(self, name: str) -> None:
        self.click(self.page.get_by_role("button", name=name, exact=True).first)

    def fill(self, what: Locator, text: str) -> None:
        self.actions += 1
        what.fill(text)

    def choose(self, what: Locator, value: str) -> None:
        self.actions += 1
        what.select_option(value)

    def press(self, key: str) -> None:
        self.actions += 1
        self.page.keyboard.press(key)

    def drop(self, name: str, content: str) -> None:
        self.actions += 1
        dropped = self.page.evaluate_handle(
            """([name, text]) => {
              const files = new DataTransfer();
              files.items.add(new File([text], name, { type: "text/csv" }));
              return files;
            }""",
            [name, content],
        )
        self.page.locator(".drop").dispatch_event("drop", {"dataTransfer": dropped})

    def save(self, what: Locator, to: Path) -> Path:
        with self.page.expect_download() as download:
            self.click(what)
        download.value.save_as(to)
        return to


@pytest.fixture
def hand(page: Page, server: Server) -> Iterator[Hand]:
    """On the first screen of a workspace without cases."""
    for name in ("heated_motor", "mine"):
        server.ask("DELETE", f"/api/cases/{name}")
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Does your model")
    user = Hand(page)
    yield user
    assert 0 < user.actions <= MOST


@pytest.fixture
def example(hand: Hand) -> Hand:
    hand.button("Open the example heated_motor")
    expect(hand.page.locator(".lead .chip.missing")).to_be_visible()
    return hand


@pytest.fixture
def added(example: Hand) -> Hand:
    example.button("Discover")
    card = example.page.locator(".card[data-effects=motor_heating]")
    example.click(card.get_by_role("button", name="Add motor_heating"))
    expect(example.page.locator(".lead .chip.adequate")).to_be_visible()
    return example


def bench(comma: bool = False) -> str:
    """Runs of a wheel of somebody's own; with decimal commas between semicolons."""
    random = Random(5)
    lines = ["run,w_shell [rad/s],i_motor_mA"]
    for run in range(8):
        for k in range(6):
            omega = 2.0 + run + 0.1 * k
            torque = 0.092 * 0.08 * 18.639 + 0.012 + 3e-3 * omega + random.gauss(0, 6e-4)
            lines.append(f"r{run},{omega:.5f},{1e3 * torque * 18 / 80 / 0.1:.3f}")
    text = "\n".join(lines) + "\n"
    return text.replace(",", ";").replace(".", ",") if comma else text


def test_open_a_file_of_ones_own_and_back(hand: Hand, server: Server) -> None:
    """The file's look, the mapping, the case; undone, the mapping is there as it was, and makes the same case."""
    page = hand.page
    hand.drop("mine.csv", bench())
    form = page.get_by_role("form", name="Map the columns")
    hand.click(form.get_by_text("What the file holds"))
    expect(form.locator("pre")).to_contain_text("w_shell")
    hand.fill(form.get_by_label("load, N"), "18.639")
    hand.button("Make the case")
    expect(page.locator(".lead .chip")).to_be_visible()
    file = server.workspace / "cases" / "mine" / "case.toml"
    made = file.read_bytes()
    expect(page.get_by_role("button", name="Undo", exact=True)).to_be_enabled()
    page.locator("h1").focus()
    hand.press("Control+z")
    expect(form.get_by_label("load, N")).to_have_value("18.639")
    assert not file.parent.exists()
    hand.button("Make the case")
    expect(page.locator(".lead .chip")).to_be_visible()
    assert file.read_bytes() == made


def test_see_where_it_fails(example: Hand) -> None:
    page = example.page
    where = page.locator(".lead .facts button").first
    expect(where).to_contain_text("temperature")
    example.click(where)
    expect(page.locator(".plots").get_by_role("img", name="Residual of current")).to_have_accessible_name(
        re.compile("against temperature.*stands out at")
    )


def test_add_what_is_missing(added: Hand) -> None:
    expect(added.page.locator(".ladder")).to_have_attribute("data-rungs", "3")


def test_take_it_back(added: Hand, server: Server) -> None:
    shipped = Path(__file__).resolve().parents[2] / "cases" / "heated_motor" / "case.toml"
    added.page.locator("h1").focus()
    added.press("Control+z")
    expect(added.page.locator(".lead .chip.missing")).to_be_visible()
    assert (server.workspace / "cases" / "heated_motor" / "case.toml").read_bytes() == shipped.read_bytes()


def test_hold_two_runs_out(example: Hand, server: Server) -> None:
    page, runs = example.page, example.page.get_by_label("Held-out runs")
    before = set(server.get("/api/cases/heated_motor")["runs"]["test"])
    for name in ("r02", "r03"):
        example.click(runs.get_by_role("checkbox", name=name))
    example.button("Hold these out")
    expect(page.get_by_role("button", name="Undo", exact=True)).to_be_enabled()
    assert set(server.get("/api/cases/heated_motor")["runs"]["test"]) == before | {"r02", "r03"}


def test_compare_two_models(example: Hand) -> None:
    """Over each other with the errors of both, then side by side on the same axes; over a product of columns."""
    page = example.page
    panel = page.get_by_label("Compare with another")
    example.choose(panel.get_by_label("Compare with", exact=True), "model:")
    expect(panel.get_by_role("row", name="other")).to_contain_text("33.1")
    expect(panel.get_by_role("row", name="this")).to_contain_text("8.61")
    expect(page.locator(".plots .key.other", has_text="rolling_steady").first).to_be_visible()
    example.choose(panel.get_by_label("How to show both"), "apart")
    beside = page.get_by_role("img", name="current measured and predicted")
    expect(beside).to_have_count(2)
    example.choose(page.locator(".axis").get_by_label("\N{MULTIPLICATION SIGN}"), "omega")
    expect(page.get_by_role("img", name="Residual of current").first).to_have_accessible_name(
        re.compile("against temperature . omega")
    )


def test_export(added: Hand, tmp_path: Path) -> None:
    added.button("Export parameters")
    link = added.page.get_by_role("link", name="Save the parameters")
    expect(link).to_be_visible()
    assert "comp_heating" in added.save(link, tmp_path / "robot.toml").read_text()


def test_drive_the_simulated_robot_and_stop_it(hand: Hand, server: Server) -> None:
    """A machine that kept the page's heart waiting for 0.4 s has let go: then arm and run once more."""
    server.warm_live()
    page = hand.page
    hand.click(page.get_by_role("link", name="Drive a robot in simulation"))
    expect(page.locator("#context")).to_have_text("simulated robot")
    watched, panel = hand.actions, page.locator(".drive-panel")
    for _ in range(20):
        hand.actions = watched  # of the attempt that runs
        if page.locator("[data-tile=Faults] .bad").count():
            page.get_by_role("button", name="Clear faults").click()
            expect(page.locator("[data-tile=Faults]")).to_contain_text("none")
        expect(page.get_by_role("button", name="Arm …")).to_be_enabled()
        with suppress(Exception):
            page.set_default_timeout(10_000)
            hand.button("Arm …")
            hand.press("Enter")
            hand.fill(panel.get_by_label("Setpoint as a number"), "0.3")
            hand.button("Run")
            expect(page.locator("[data-tile=State]")).to_contain_text(re.compile("run|limiting"), timeout=5000)
            break
    page.set_default_timeout(300_000)
    hand.press("Space")
    expect(page.locator("[data-tile=Faults]")).to_contain_text("stop_all")
    expect(page.locator("[data-tile=State]")).to_contain_text("bridge off")
    server.ask("DELETE", "/api/live")


def test_find_why_a_run_of_a_batch_failed(hand: Hand) -> None:
    page = hand.page
    hand.click(page.get_by_role("link", name="Simulate"))
    hand.choose(page.locator("#sim-scenario"), "slope_limiter")
    hand.fill(page.get_by_label("Seeds"), "1:8")
    hand.fill(page.get_by_label("Varied, one field a line"), "path.2.slope=2deg:16deg")
    hand.button("Run as a batch")
    failed = page.get_by_label("Runs that failed").get_by_role("button").first
    expect(failed).to_be_visible()
    words = failed.text_content() or ""
    why = words.partition(": ")[2]
    expect(page.locator(".batch-failed").first).to_be_visible()
    hand.click(failed)
    expect(page.get_by_label("Moment")).to_be_enabled()
    expect(page.locator(".checks li", has=page.locator(".bad")).first).to_contain_text(why.split()[0])
    settings = re.match(r"seed (\d+), path\.2\.slope ([\d.]+) deg: ", words)
    assert settings is not None, words
    expect(page.locator(".checks")).to_contain_text("This run: path.2.slope")
    expect(page.locator(".checks")).to_contain_text("The controller: run from ")
    expect(page.locator("#command")).to_contain_text(re.compile(r"terrapin run .*--seed \d"))
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    expect(page.locator(".sim-form .soft").first).to_contain_text("slope_limiter as in the run slope_limiter-")
    slope = page.locator(".slider", has=page.get_by_label("slope from 1.5 m")).locator("output")
    expect(slope).to_contain_text(f"{float(settings[2]):.3g}")
    expect(page.get_by_label("seed", exact=True)).to_have_value(settings[1])


def test_a_figure_for_a_paper(example: Hand, tmp_path: Path) -> None:
    button = example.page.get_by_role("button", name="Model and measurement: save as SVG, for a paper")
    tree = ElementTree.parse(example.save(button, tmp_path / "figure.svg"))
    words = [text.text for text in tree.iter("{http://www.w3.org/2000/svg}text")]
    assert {"current, A", "temperature, degC"} <= set(words)
    assert "font" in (tmp_path / "figure.svg").read_text()


def test_a_table_is_read_otherwise(hand: Hand) -> None:
    """Not one of the ten: another reading is looked at again, kept over a reload, and stands in the command."""
    page = hand.page
    hand.drop("comma.csv", bench(comma=True))
    form = page.get_by_role("form", name="Map the columns")
    row = form.get_by_role("row", name="w_shell [rad/s]")
    expect(row).to_contain_text("2  2.1")
    hand.click(form.get_by_text("Read it otherwise"))
    hand.choose(form.get_by_label("separator"), "bar")
    hand.button("Read it again")
    expect(form).to_contain_text("found no column of numbers")
    hand.choose(form.get_by_label("separator"), "semicolon")
    hand.choose(form.get_by_label("decimal mark"), "comma")
    hand.button("Read it again")
    expect(row).to_contain_text("2  2.1")
    expect(page.locator("#command")).to_contain_text("--read=decimal=comma")
    page.reload()
    expect(form.get_by_label("decimal mark")).to_have_value("comma")
    page.get_by_role("button", name="Discard").click()
    expect(form).to_have_count(0)
