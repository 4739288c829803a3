"""The Workbench tab as a user goes through it: a case opened, compared, discovered, an effect added and removed."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from random import Random

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, Route, expect
from serving import Server

from tests.waiting import wait_for

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
    expect(page.locator(".lead .chip.missing")).to_be_visible()
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
    expect(page.locator(".lead .chip.adequate")).to_be_visible()
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
    expect(page.locator(".lead .chip.missing")).to_be_visible()
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


def one_load() -> bytes:
    """A table that lacks friction in the bearings, and one of two effects that are the same at the only load."""
    random = Random(3)
    lines = ["run,w_shell [rad/s],i_motor_mA"]
    for run in range(10):
        middle = random.uniform(2.5, 9.0)
        for _ in range(8):
            omega = middle * random.gauss(1.0, 0.1)
            torque = 0.092 * 0.08 * 18.639 + 0.012 + 3e-3 * omega + 0.28e-3 * omega**2 * 0.08 * 18.639
            lines.append(f"r{run:02d},{omega:.5f},{1e3 * (torque * 18 / 80 / 0.1 + random.gauss(0, 0.0015)):.3f}")
    return ("\n".join(lines) + "\n").encode()


def drop(page: Page, name: str, content: bytes) -> None:
    """A file let go over the page."""
    dropped = page.evaluate_handle(
        """([name, text]) => {
          const files = new DataTransfer();
          files.items.add(new File([text], name, { type: "text/csv" }));
          return files;
        }""",
        [name, content.decode()],
    )
    page.locator(".drop").dispatch_event("drop", {"dataTransfer": dropped})


def kept(server: Server, constant: str) -> str:
    """What the server has of a constant of the mapping that is half done."""
    found = server.get("/api/uploads?drafts=true")
    return str(found[0]["draft"]["constants"].get(constant)) if found and found[0]["draft"] else ""


def test_the_whole_way_from_a_dropped_table_to_the_report(page: Page, server: Server) -> None:
    """Drop, map, reload, make, compare, discover, experiment, add, remove, own effect, controller, report."""
    command = page.locator("#command")
    drop(page, "one_load.csv", one_load())
    form = page.get_by_role("form", name="Map the columns")
    expect(form.get_by_label("what w_shell [rad/s] is")).to_have_value("omega")
    expect(form.get_by_label("what i_motor_mA is")).to_have_value("current")
    expect(form.get_by_label("unit of i_motor_mA")).to_have_value("mA")
    expect(form.get_by_role("row", name="w_shell [rad/s]")).to_contain_text("3.673  3.596")  # the first values
    expect(form.get_by_role("combobox", name="run", exact=True)).to_have_value("run")
    form.get_by_label("title").fill("One load")
    form.get_by_label("noise sd of i_motor_mA").fill("1,5")
    form.get_by_role("button", name="Make the case").click()
    expect(form.get_by_role("alert")).to_contain_text("found 1,5, expected a number above 0")
    form.get_by_label("noise sd of i_motor_mA").fill("1.5")
    form.get_by_label("load, N").fill("18.639")
    wait_for(lambda: page.wait_for_timeout(50) or kept(server, "load") == "18.639")  # the page goes on meanwhile
    assert serious(page) == []
    page.reload()
    other = page.context.new_page()  # a second browser sees the same
    other.goto(page.url)
    for one in (page, other):
        again = one.get_by_role("form", name="Map the columns")
        expect(again.get_by_label("title")).to_have_value("One load")
        expect(again.get_by_label("noise sd of i_motor_mA")).to_have_value("1.5")
        expect(again.get_by_label("load, N")).to_have_value("18.639")
    page.get_by_role("link", name="Live").click()  # and back: what is being mapped is still there
    page.get_by_role("link", name="Workbench").click()
    expect(command).to_contain_text("'--title=One load'")
    shown = command.inner_text()
    form.get_by_role("button", name="Make the case").click()
    expect(page.locator(".lead .chip.missing")).to_be_visible()
    expect(other.get_by_role("form", name="Map the columns")).to_have_count(0)
    other.close()
    job = next(job for job in server.get("/api/jobs") if job["do"] == "make")
    assert job["command"] == shown
    assert server.get("/api/cases/one_load")["columns"]["current"]["unit"] == "A"

    page.get_by_role("button", name="Compare").click()
    expect(command).to_have_text("terrapin compare ws/cases/one_load")
    expect(page.locator(".plots canvas").first).to_be_visible()
    page.get_by_role("button", name="Discover").first.click()
    expect(page.locator(".lead .chip.ambiguous")).to_be_visible()
    plan = page.get_by_role("region", name="Next experiment")
    expect(plan).to_contain_text("load, N")
    assert serious(page) == []
    plan.get_by_label("What the simulated robot has").select_option("speed_squared + viscous_friction")
    plan.get_by_role("button", name="Run it in the simulator").click()
    expect(page.locator("#context")).to_contain_text(re.compile(r"One load, and \d+ simulated runs"))
    expect(page.get_by_role("heading", level=1)).to_contain_text("the model lacks speed_squared + viscous_friction")
    assert "not measured" in server.get("/api/cases/one_load-simulated")["toml"]
    assert rungs(page)[0] == 1
    high = rungs(page)[1]

    both = page.get_by_role("button", name="Add all")
    both.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".ladder")).to_have_attribute("data-rungs", "3")
    expect(page.locator(".lead .chip.adequate")).to_be_visible()
    floor = rungs(page)[1]
    assert floor < 1.3 < 2.0 < high
    remove = page.get_by_role("button", name="Remove speed_squared")
    expect(page.get_by_role("button", name="Remove")).to_have_count(2)
    expect(page.locator("button:focus")).to_have_text("Remove")  # what was pressed is gone: next is what undoes it
    remove.focus()
    page.keyboard.press("Enter")
    expect(page.locator(".ladder")).to_have_attribute("data-rungs", "2")
    expect(page.locator(".lead .chip.missing")).to_be_visible()
    focused = page.locator("button:focus")
    expect(focused).to_have_count(1)
    assert (focused.get_attribute("aria-label") or focused.inner_text()) in ("Add speed_squared", "Discover")

    page.get_by_text("Own effect").click()
    own = page.locator(".own")
    own.get_by_label("name", exact=True).fill("quadratic")
    own.get_by_label("expression").fill("k * load * omega**2")
    expect(own.locator(".good")).to_contain_text("sound: k in")
    own.get_by_role("button", name="Add it").click()
    expect(page.get_by_role("button", name="Remove quadratic")).to_be_visible()
    expect(page.locator(".lead .chip.adequate")).to_be_visible()
    assert rungs(page)[1] < 2.0
    expect(command).to_contain_text("one_load-simulated quadratic '--expression=k * load * omega**2' --target=")
    page.get_by_role("button", name="Remove quadratic").click()
    expect(page.locator(".lead .chip.missing")).to_be_visible()
    page.get_by_role("button", name="Discover").first.click()
    page.locator(".card[data-effects=speed_squared]").get_by_role("button", name="Add speed_squared").click()
    expect(remove).to_be_visible()
    expect(page.locator(".lead .chip.adequate")).to_be_visible()
    assert rungs(page) == (3, pytest.approx(floor))

    page.get_by_role("button", name="Export parameters").click()
    controller = page.get_by_role("region", name="Send to controller")
    expect(controller.get_by_role("link", name="Save the parameters")).to_be_visible()
    expect(controller).to_contain_text("error")
    expect(command).to_contain_text("&& terrapin run ")
    page.get_by_role("button", name="Report").click()
    with page.expect_download() as saved:
        page.get_by_role("link", name="save it").click()
    assert re.search(r"One load, and \d+ simulated runs", Path(saved.value.path()).read_text(encoding="utf-8"))
    assert serious(page) == []


def test_making_a_case_is_cancelled_in_the_page(page: Page, server: Server) -> None:
    lines = "".join(f"r{i // 4000},{2.0 + i % 7},{100 + i % 11}\n" for i in range(800_000))
    content = f"run,w_shell [rad/s],i_motor_mA\n{lines}".encode()
    file = {"name": "long_one.csv", "mimeType": "text/csv", "buffer": content}
    page.locator("#files").set_input_files([file])  # type: ignore[list-item]
    form = page.get_by_role("form", name="Map the columns")
    expect(form).to_be_visible()
    # the page itself presses the button as soon as it shows: reading takes seconds, and a busy machine's keys as long
    page.evaluate(
        """() => new MutationObserver((_, observer) => {
            const bar = document.querySelector('form [role=status]');
            const stop = [...(bar?.querySelectorAll('button') ?? [])].find((b) => b.textContent === 'Cancel');
            if (!stop || !bar.textContent.includes('reading the case ...')) return;
            observer.disconnect();
            window.focusedCancel = document.activeElement === stop;
            stop.click();
        }).observe(document.body, {subtree: true, childList: true, characterData: true})"""
    )
    form.get_by_role("button", name="Make the case").click()
    expect(form.get_by_role("alert")).to_have_text("Cancelled: nothing was made.")
    assert page.evaluate("window.focusedCancel")
    expect(form.get_by_role("button", name="Make the case")).to_be_focused()
    assert server.ask("GET", "/api/cases/long_one").status == 404
    assert list((server.workspace / "cases").glob(".new-*")) == []
    form.get_by_role("button", name="Discard").click()
    expect(form).to_have_count(0)
    wait_for(lambda: page.wait_for_timeout(50) or "long_one.csv" not in {u["name"] for u in server.get("/api/uploads")})


def test_a_heading_with_an_umlaut_is_proposed_as_a_name_in_letters(page: Page) -> None:
    content = "t [s];Öltemperatur [°C];Moment [N m]\n" + "".join(f"{i};{20 + i % 7};{3 + i % 5}\n" for i in range(40))
    file = {"name": "bath.csv", "mimeType": "text/csv", "buffer": content.encode()}
    page.locator("#files").set_input_files([file])  # type: ignore[list-item]
    form = page.get_by_role("form", name="Map the columns")
    form.get_by_role("combobox", name=re.compile("^model")).select_option("equation")
    expect(form.get_by_label("name of Öltemperatur [°C]")).to_have_value("oeltemperatur")
    form.get_by_role("button", name="Discard").click()
    expect(form).to_have_count(0)


def test_all_files_that_are_chosen_at_once_are_mapped(page: Page, server: Server) -> None:
    """Only the first was sent: emptying the input emptied the list that was being gone through."""
    files = [
        {
            "name": f"cart_{i}.csv",
            "mimeType": "text/csv",
            "buffer": b"force [N],way [mm]\n" + b"1.5,3\n2.5,5\n" * (10 + i),
        }
        for i in range(3)
    ]
    page.locator("#files").set_input_files(files)  # type: ignore[arg-type]
    form = page.get_by_role("form", name="Map the columns")
    expect(form).to_contain_text("cart_0.csv, cart_1.csv, cart_2.csv: 66 rows")
    form.get_by_role("button", name="Discard").click()
    expect(form).to_have_count(0)
    wait_for(
        lambda: page.wait_for_timeout(50) or not any(u["name"].startswith("cart_") for u in server.get("/api/uploads"))
    )


def test_a_formula_names_its_parameters_and_no_exponent_is_one(page: Page) -> None:
    """2e3 made a parameter e3, and a name with a space took its column out without a word."""
    content = "run,force [N],way [mm]\n" + "".join(f"r{i // 10},{20 + i % 7},{3 + i % 5}\n" for i in range(40))
    page.locator("#files").set_input_files(  # type: ignore[arg-type]
        [{"name": "spring.csv", "mimeType": "text/csv", "buffer": content.encode()}]
    )
    form = page.get_by_role("form", name="Map the columns")
    model = form.get_by_role("combobox", name=re.compile("^model"))
    model.select_option("equation")
    form.get_by_label("predicted").select_option("force")
    form.get_by_label("by the formula").fill("2e3*way + k*wya**1.5e0 + sqrt(way)")
    expect(form).to_contain_text("become parameters to fit: k, wya.")
    expect(page.locator("#command")).to_contain_text("--fit=k=0.0 --fit=wya=0.0 '--equation=")
    name = form.get_by_label("name of way [mm]")
    name.fill("my way")
    form.get_by_label("by the formula").click()
    form.get_by_role("button", name="Make the case").click()
    expect(form.get_by_role("alert")).to_contain_text("name of way [mm]: found my way, expected letters a to z")
    name.fill("way")
    form.get_by_label("by the formula").click()
    form.get_by_label("by the formula").fill("k*way + 2e1")
    form.get_by_role("button", name="Make the case").click()
    expect(page.locator(".below .panel", has_text="Parameters of the model")).to_contain_text("force =")


def test_no_heading_stands_over_nothing_and_the_verdict_keeps_its_room(page: Page) -> None:
    """After discover without a candidate a heading stood alone; the name of a long set left the verdict a tenth of the
    line."""

    def answer_with(**changes: object) -> None:
        def changed(route: Route) -> None:
            route.fulfill(json={**route.fetch().json(), **changes})

        page.unroute_all(behavior="wait")
        page.route("**/api/cases/heated_motor/view", changed)
        page.reload()

    page.get_by_role("button", name="Open the example heated_motor").click()
    expect(page.locator(".lead .chip")).to_be_visible()
    heading = "Too small to tell, if there at all"
    answer_with(discovered=True, verdict="adequate", heading=heading, cards=[], missing=[])
    expect(page.locator(".lead .chip.adequate")).to_be_visible()
    expect(page.get_by_role("heading", name="Own effect")).to_be_visible()
    expect(page.get_by_role("heading", name=heading)).to_have_count(0)
    many = ["expression_1", "rut_recovery", "slip_sinkage_at_axle", "load_transfer"]
    told = "With probability 0.91 the model lacks " + " + ".join(many) + " and nothing else."
    answer_with(headline=told, missing=many, discovered=False, next={"do": "add", "text": ""})
    expect(page.get_by_role("button", name="Add expression_1 + rut_recovery")).to_be_visible()
    line, verdict = (page.locator(part).bounding_box() for part in (".lead", ".lead .row"))
    assert line
    assert verdict
    assert verdict["width"] > 0.5 * line["width"]
    page.unroute_all(behavior="wait")


ORDERED = """async ([mapped, cases]) => {
    const { OwnEquations } = await import('/static/mapping/own_equations.js');
    return cases.map((typed) => {
        const own = new OwnEquations(mapped.map((name) => ({ name })), typed);
        const inputs = [...own.parameters.children].map((row) => [...row.querySelectorAll('input')]);
        const bounds = inputs.map((row) => row.map((one) => one.disabled));
        try { return [own.order(), bounds]; } catch (error) { return error.message; }
    });
}"""
OWN = {
    "state_1_name": "x", "state_1_unit": "mm", "state_1_initial": "fit", "state_1_derivative": "v",
    "state_2_name": "v", "state_2_unit": "m/s", "state_2_initial": "0", "state_2_derivative": "(force - d*v)/m",
    "measured_1_channel": "position", "measured_1_formula": "x",
    "measured_2_channel": "speed", "measured_2_formula": "v",
    "is_m": "known", "start_m": "1.3", "unit_m": "kg", "min_m": "1", "start_d": "0.5", "min_d": "0", "max_d": "4",
}  # fmt: skip
WRONG_OWN = [
    ({"state_2_name": "2v"}, "state 2: found 2v, expected a name of letters"),
    ({"state_2_name": "x"}, "state 2: found x once more, expected another name"),
    (
        {"state_2_initial": "rest"},
        "v starts at: found rest, expected fit, a number or one of time, force, position, speed",
    ),
    ({"state_1_derivative": ""}, "derivative of x: found nothing, expected a formula"),
    ({"measured_2_channel": "sped"}, "measured 2: found sped, expected one of force, position, speed"),
    ({"measured_2_channel": "position"}, "measured 2: found position once more, expected another column"),
    ({"measured_2_formula": ""}, "measured 2: speed: found no formula, expected one of the states"),
    ({"start_d": ""}, "start value of d: found nothing, expected a number"),
    ({"max_d": "4,5"}, "max of d: found 4,5, expected a number"),
]


def test_equations_of_ones_own_are_ordered_as_they_were_typed(page: Page) -> None:
    """What is wrong is said by the row's name; a parameter that is known has no bounds."""
    columns = ["time", "force", "position", "speed"]
    (right, bounds), *wrong = page.evaluate(ORDERED, [columns, [OWN, *({**OWN, **more} for more, _ in WRONG_OWN)]])
    assert right == {
        "states": {"x": {"initial": "fit", "unit": "mm"}, "v": {"initial": 0, "unit": "m/s"}},
        "derivative": {"x": "v", "v": "(force - d*v)/m"},
        "measured": {"position": "x", "speed": "v"},
        "fit": {"d": {"value": 0.5, "unit": "", "min": 0, "max": 4}},
        "parameters": {"m": "1.3 kg"},
    }
    assert bounds == [[False, False, False, False], [False, True, True, False]]  # of d, of m: start, min, max, unit
    for said, (_, expected) in zip(wrong, WRONG_OWN, strict=True):
        assert expected in said
    (timeless,) = page.evaluate(ORDERED, [columns[1:], [OWN]])
    assert "time: no column is mapped to it" in timeless


def test_the_list_shows_commands_that_do_the_same(page: Page, server: Server) -> None:
    """What stands in the strip, typed into a shell in the server's folder."""
    command = page.locator("#command")
    page.get_by_role("button", name="Open the example forced_slip_sand").click()
    expect(page.locator(".lead .chip")).to_be_visible()
    folder = "ws/cases/forced_slip_sand"
    expect(command).to_have_text(f"terrapin case example forced_slip_sand --to {folder} && terrapin compare {folder}")
    page.get_by_role("link", name="Cases").click()
    expect(command).to_have_text("terrapin compare ws/cases")
    page.on("dialog", lambda dialog: dialog.dismiss())
    page.get_by_role("button", name="Delete forced_slip_sand").click()
    shown = command.inner_text()
    assert server.get("/api/cases/forced_slip_sand")["name"] == "forced_slip_sand"
    subprocess.run(["sh", "-c", shown], cwd=server.folder, check=True)
    page.reload()
    expect(page.get_by_role("button", name="Open the example forced_slip_sand")).to_be_visible()
    expect(page.get_by_role("button", name="Delete forced_slip_sand")).to_have_count(0)
    assert server.ask("GET", "/api/cases/forced_slip_sand").status == 404


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
