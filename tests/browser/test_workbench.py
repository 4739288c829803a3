"""The Workbench tab as a user goes through it: a case opened, compared, discovered, an effect added and removed."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect
from serving import Server

SERIOUS = ("serious", "critical")


def serious(page: Page) -> list[str]:
    """What axe finds that would keep somebody from using the page."""
    found = Axe().run(page).response["violations"]
    return [f"{v['id']}: {v['nodes'][0]['target']}: {v['help']}" for v in found if v["impact"] in SERIOUS]


def rungs(page: Page) -> tuple[int, float]:
    """Rungs of the ladder and the held-out error of the last, as drawn."""
    ladder = page.locator(".ladder")
    return int(ladder.get_attribute("data-rungs") or 0), float(ladder.get_attribute("data-heldout") or "nan")


def open_example(page: Page, name: str) -> None:
    page.get_by_role("link", name="Workbench").click()
    page.get_by_role("button", name=f"Open the example {name}").click()
    expect(page.locator(".lead .chip")).to_be_visible()


def test_from_the_example_to_the_noise_floor_and_back(page: Page, server: Server) -> None:
    assert "token" not in page.url
    assert serious(page) == []
    open_example(page, "heated_motor")
    expect(page.locator(".chip.missing")).to_be_visible()
    expect(page.locator(".ladder")).to_have_attribute("data-rungs", "2")
    for place in (".plots .tall", ".plots .pair .plot", ".ladder"):  # all on the first screen
        box = page.locator(place).first.bounding_box()
        assert box is not None
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= page.locator(".strip").bounding_box()["y"]  # type: ignore[index]
    assert serious(page) == []

    page.get_by_role("button", name="Discover").first.click()
    card = page.locator(".card[data-effects=motor_heating]")
    expect(card).to_contain_text("Takes away 100 % of the misfit")
    assert card.locator("math").count() == 1
    expect(page.locator("#command")).to_contain_text("terrapin discover ")
    expect(page.locator(".ladder .ghost")).to_have_count(2)  # what it would do, before it is added
    assert rungs(page)[0] == 2
    assert serious(page) == []

    card.get_by_role("button", name="Add motor_heating").click()
    expect(page.locator(".ladder")).to_have_attribute("data-rungs", "3")
    count, error = rungs(page)
    assert (count, error) == (3, pytest.approx(1.10, abs=0.01))  # two held-out runs of six rows: 1.0 and some scatter
    expect(page.locator("#command")).to_contain_text("terrapin add ")
    expect(page.get_by_role("heading", level=1)).to_contain_text("Nothing is missing")
    expect(page.locator(".chip.adequate")).to_be_visible()
    ladder = server.get("/api/cases/heated_motor")["ladder"]
    assert ladder[-1]["heldout_error"] == pytest.approx(error)
    assert serious(page) == []

    page.get_by_role("button", name="Export parameters").click()
    controller = page.get_by_role("region", name="Send to controller")
    expect(controller).to_contain_text("comp_heating")
    before, after = controller.locator("b").inner_text().removesuffix(" mN m").split(" → ")
    assert float(after) < 0.2 * float(before)
    expect(page.locator("#command")).to_contain_text("&& terrapin run heated_winding --parameters ")

    page.get_by_role("button", name="Report").click()
    link = page.get_by_role("link", name="open it")
    expect(link).to_be_visible()
    report = page.request.get(str(link.evaluate("a => a.href")))
    assert report.ok
    assert "Steady rolling on dry sand" in report.text()

    page.get_by_role("button", name="Remove motor_heating").click()
    expect(page.locator(".ladder")).to_have_attribute("data-rungs", "2")
    expect(page.locator(".chip.missing")).to_be_visible()
    assert server.get("/api/cases/heated_motor")["effects"] == ["speed_squared"]


def test_a_reload_and_a_second_browser_show_the_same(page: Page, server: Server) -> None:
    open_example(page, "forced_slip_sand")
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_contain_text("missing")
    other = page.context.new_page()
    other.goto(page.url)  # without a token in the address: the cookie is enough
    expect(other.get_by_role("heading", level=1)).to_contain_text("missing")
    page.get_by_text("Own effect").click()
    typing = page.locator(".own").get_by_label("expression")
    typing.fill("k * omega")
    job = server.start("forced_slip_sand", do="add", effects=["torque_gain"])
    assert server.wait(job)["state"] == "done"
    for one in (page, other):
        expect(one.get_by_role("button", name="Remove torque_gain")).to_be_visible()
        expect(one.locator(".ladder")).to_have_attribute("data-rungs", "2")
    expect(typing).to_be_focused()  # who types goes on typing


def test_a_dropped_table_becomes_a_case(page: Page, server: Server) -> None:
    lines = ["run,w_shell [rad/s],i_motor_mA"]
    for run in range(6):
        for row in range(8):
            omega = 2.0 + row + 0.3 * run
            torque = 0.09 * 0.08 * 20 + 0.012 + 0.001 * omega + 3e-4 * omega**2 * 0.08 * 20
            lines.append(f"{run},{omega:.3f},{1e3 * torque * 18 / 80 / 0.1 + 0.7 * ((run * 7 + row * 3) % 5 - 2):.3f}")
    files = [{"name": "day_1.csv", "mimeType": "text/csv", "buffer": "\n".join(lines).encode()}]
    page.locator("#files").set_input_files(files)  # type: ignore[arg-type]
    form = page.get_by_role("form", name="Map the columns")
    expect(form.get_by_label("what w_shell [rad/s] is")).to_have_value("omega")
    expect(form.get_by_label("what i_motor_mA is")).to_have_value("current")
    expect(form.get_by_label("unit of i_motor_mA")).to_have_value("mA")
    page.get_by_role("link", name="Live").click()  # and back: what is being mapped is still there
    page.get_by_role("link", name="Workbench").click()
    form.get_by_label("noise sd of i_motor_mA").fill("1,0")
    form.get_by_role("button", name="Make the case").click()
    expect(form.get_by_role("alert")).to_contain_text("found 1,0, expected a number above 0")
    form.get_by_label("noise sd of i_motor_mA").fill("1.0")
    assert serious(page) == []
    form.get_by_role("button", name="Make the case").click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("missing")
    assert server.get("/api/cases/day_1")["columns"]["current"]["unit"] == "A"


def one_load(folder: Path) -> None:
    """A case in which two effects are the same: only one load was measured."""
    folder.mkdir()
    random = Random(3)
    lines = ["run,w,i"]
    for run in range(10):
        middle = random.uniform(2.5, 9.0)
        for _ in range(8):
            omega = middle * random.gauss(1.0, 0.02)
            torque = 0.092 * 0.08 * 18.639 + 0.012 + 1e-3 * omega + 0.28e-3 * omega**2 * 0.08 * 18.639
            lines.append(f"r{run:02d},{omega:.5f},{1e3 * (torque * 18 / 80 / 0.1 + random.gauss(0, 0.0015)):.3f}")
    (folder / "m.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "case.toml").write_text(
        '[case]\ntitle = "One load"\n[model]\nbase = "rolling_steady"\neffects = []\n[parameters]\nradius = 0.08\n'
        "drive_radius = 0.018\ntorque_constant = 0.1\ncoulomb = 0.012\nviscous = 1e-3\nload = 18.639\n"
        '[fit]\nf_o = { value = 0.05, min = 0.0, max = 0.5 }\n[data]\nfiles = ["m.csv"]\nrun = "run"\n[data.columns]\n'
        'omega = { column = "w", unit = "rad/s" }\ncurrent = { column = "i", unit = "mA", sigma = 1.5 }\n',
        encoding="utf-8",
    )


def test_the_proposed_experiment_is_run_in_the_simulator(page: Page, server: Server) -> None:
    one_load(server.workspace / "cases" / "one_load")
    page.goto(f"{server.line.partition('?')[0]}#workbench/one_load")
    page.get_by_role("button", name="Discover").first.click()
    expect(page.locator(".chip.ambiguous")).to_be_visible()
    plan = page.get_by_role("region", name="Next experiment")
    expect(plan).to_contain_text("load, N")
    plan.get_by_label("What the simulated robot has").select_option("speed_squared")
    plan.get_by_role("button", name="Run it in the simulator").click()
    expect(page.locator("#context")).to_contain_text("One load, and 2 simulated runs")
    expect(page.locator(".chip.missing")).to_be_visible()
    expect(page.get_by_role("heading", level=1)).to_contain_text("the model lacks speed_squared")
    assert "not measured" in server.get("/api/cases/one_load-simulated")["toml"]


def test_an_effect_of_ones_own_is_checked_as_it_is_typed(page: Page) -> None:
    open_example(page, "heated_motor")
    page.get_by_text("Own effect").click()
    form = page.locator(".own")
    form.get_by_label("name", exact=True).fill("cubic")
    form.get_by_label("expression").fill("k * omega**3")
    expect(form.get_by_label("start value of k")).to_be_visible()
    expect(form.locator(".good")).to_contain_text("sound: k in")
    form.get_by_label("unit of k").fill("N m")
    expect(form.locator(".bad")).to_contain_text("expected N m")
    expect(form.get_by_role("button", name="Add it")).to_be_disabled()
    expect(page.locator("#command")).to_contain_text("'--expression=k * omega**3'")
    assert json.loads(page.evaluate("JSON.stringify(document.querySelectorAll('.own math').length)")) == 1
