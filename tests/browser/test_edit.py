"""A case is changed without fear: held-out runs by click, constants, an own effect mended in place, undo and redo."""

from __future__ import annotations

import re
import shutil
from contextlib import closing
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect
from serving import Server

from tests.waiting import wait_for


def findings(page: Page) -> list[str]:
    found = Axe().run(page).response["violations"]
    return [f"{v['id']}: {v['nodes'][0]['target']}: {v['help']}" for v in found]


def test_changes_and_back(page: Page, server: Server) -> None:
    """Each change writes case.toml; Ctrl-Z as often brings it back byte for byte; a reload knows the steps."""
    page.get_by_role("button", name="Open the example heated_motor").click()
    expect(page.locator(".lead .chip")).to_be_visible()
    file = server.workspace / "cases" / "heated_motor" / "case.toml"
    stages = [file.read_bytes()]
    undo, redo = (
        page.get_by_role("button", name="Undo", exact=True),
        page.get_by_role("button", name="Redo", exact=True),
    )
    expect(undo).to_be_disabled()

    runs = page.get_by_label("Held-out runs")
    runs.get_by_role("checkbox").first.check()
    runs.get_by_role("button", name="Hold these out").click()
    expect(undo).to_be_enabled()
    stages.append(file.read_bytes())
    assert b"test = " in stages[-1]

    constant = page.get_by_label("coulomb, with its unit")
    constant.fill("13 mN m")
    constant.press("Enter")
    expect(page.locator("#command")).to_contain_text("terrapin case set")
    expect(page.get_by_label("Known constants")).to_contain_text("0.013")
    stages.append(file.read_bytes())

    page.get_by_text("Own effect").click()
    page.get_by_label("expression").fill("k * omegaa")
    page.get_by_label("name", exact=True).fill("drag")
    expect(page.locator(".own [role=status]")).not_to_have_text("")
    page.reload()  # what is typed is still there
    expect(page.get_by_label("expression")).to_have_value("k * omegaa")
    page.get_by_label("expression").fill("k * omega")
    page.get_by_label("unit of k").fill("N m s/rad")
    page.get_by_role("button", name="Add it").click()
    expect(page.get_by_role("button", name="Remove drag")).to_be_visible()
    stages.append(file.read_bytes())
    page.get_by_role("button", name="Edit drag").click()
    expect(page.get_by_label("expression")).to_have_value("k * omega")
    page.get_by_label("expression").fill("k * omega**2")
    page.get_by_label("unit of k").fill("N m s^2/rad^2")
    page.get_by_role("button", name="Replace it").click()
    expect(page.get_by_role("button", name="Add it")).to_be_visible()
    stages.append(file.read_bytes())
    assert stages[-1].count(b"[effect.drag]") == 1
    assert len(set(stages)) == 5

    assert findings(page) == []
    for place in (3, 2, 1, 0):
        page.locator("h1").click()  # where nobody types
        expect(undo).to_be_enabled()
        page.keyboard.press("Control+z")
        expect(page.locator("#command")).to_contain_text("terrapin case undo")
        wait_for(lambda stage=stages[place]: file.read_bytes() == stage)
        expect(page.locator(".job")).to_be_hidden()
    expect(undo).to_be_disabled()
    page.reload()
    expect(redo).to_be_enabled()
    redo.click()
    wait_for(lambda: file.read_bytes() == stages[1])


def test_what_is_wrong_is_said_where_it_happened(server: Server, browser: Browser) -> None:
    """An absent case, an absent source, a file that is none, a slip in a formula, a model without numbers; each is
    mended without a reload."""
    server.ask("POST", "/api/examples/heated_motor")
    without = server.workspace / "cases" / "without"
    shutil.copytree(Path(__file__).parents[2] / "cases" / "heated_motor", without)
    (without / "case.toml").write_text(
        '[case]\ntitle = "w"\n\n[model]\nbase = "equation"\n\n[model.equation]\ncurrent = "k*log(0*speed)"\n\n'
        '[fit]\nk = { value = 1 }\n\n[data]\nfiles = ["runs.csv"]\nrun = "run"\n\n[data.columns]\n'
        'speed = { column = "shell_speed", unit = "rad/s" }\ncurrent = { column = "motor_current", unit = "mA" }\n'
    )
    with closing(browser.new_context()) as context:  # of its own: the browser's console notes each refusal
        page = context.new_page()
        page.goto(f"{server.line}#workbench/nothere")
        expect(page.get_by_text("found no 'nothere' in the workspace")).to_be_visible()
        page.evaluate("location.hash = '#live/robot:nothere'")
        expect(page.locator(".tab-live > .notice")).to_contain_text("found no “robot:nothere” to watch")
        page.get_by_role("link", name="Workbench").click()
        wrong = [{"name": "junk.csv", "mimeType": "text/csv", "buffer": bytes(range(256))}]
        page.locator("#files").set_input_files(wrong)  # type: ignore[arg-type]
        expect(page.get_by_role("alert")).to_have_text(re.compile("^junk.csv: byte 128 is not UTF-8 text"))
        page.get_by_role("button", name="Dismiss").click()
        parted = [{"name": "parted.csv", "mimeType": "text/csv", "buffer": b"a,b\n1,2\n\n3,4\n"}]
        page.locator("#files").set_input_files(parted)  # type: ignore[arg-type]
        expect(page.get_by_role("alert")).to_have_text(re.compile("^parted.csv:4: found an empty or broken line"))
        page.get_by_role("button", name="Dismiss").click()
        page.evaluate("location.hash = '#workbench/without'")
        expect(page.get_by_role("alert")).to_contain_text("the model gives")
        expect(page.get_by_role("button", name="Undo", exact=True)).to_be_visible()
        expect(page.locator(".case-grid")).to_be_hidden()  # no picture of numbers that there are not
        page.get_by_role("link", name="Workbench").click()
        page.get_by_role("link", name="Steady rolling on dry sand").click()
        page.get_by_role("button", name="Compare", exact=True).click()
        expect(page.get_by_text("Compared again: nothing in the case has changed")).to_be_visible()
        page.get_by_text("Own effect").click()
        page.get_by_label("expression").fill("f_o * viscous * omega")  # what stands in the model already
        expect(page.locator(".own")).to_contain_text("f_o is the model's own, one value in both")
        page.get_by_label("expression").fill("k * omga")
        expect(page.locator(".own")).to_contain_text("or is omega meant?")
        page.get_by_label("expression").fill("k * omega")
        expect(page.locator(".own")).to_contain_text("sound: k in")
        expect(page.locator(".own")).not_to_contain_text("meant?")


def test_a_constant_and_a_noise_sd_say_what_they_expect(page: Page, server: Server) -> None:
    """An emptied constant, a decimal comma and \u00b5m were answered with a regular expression; 1e400 was dropped."""
    server.ask("POST", "/api/examples/heated_motor")
    page.goto(f"{server.line}#workbench/heated_motor")
    page.reload()
    field, said = page.get_by_label("radius, with its unit", exact=True), page.locator(".notice.bad")
    for text, words in (
        ("", "radius: found nothing, expected a number and its unit, such as"),
        ("80,5 mm", "parameters.radius: found '80,5 mm', expected a number, a space and a unit such as '80 mm'"),
        ("-1 \u00b5m", "parameters.radius: found -1e-06 m, expected more than 0"),
    ):
        field.fill(text)
        field.press("Enter")
        expect(said).to_contain_text(words)
    runs = page.get_by_role("region", name="Held-out runs")
    for box in runs.get_by_role("checkbox").all():
        box.uncheck()
    page.get_by_role("button", name="Hold these out").click()
    expect(page.locator(".below li").last).to_contain_text("held out nothing: held out")
    page.get_by_role("link", name="Cases").click()
    content = "run,force [N],way [mm]\n" + "".join(f"r{i // 10},{20 + i % 7},{3 + i % 5}\n" for i in range(40))
    page.locator("#files").set_input_files(  # type: ignore[arg-type]
        [{"name": "spring.csv", "mimeType": "text/csv", "buffer": content.encode()}]
    )
    form = page.get_by_role("form", name="Map the columns")
    form.get_by_role("combobox", name=re.compile("^model")).select_option("equation")
    form.get_by_label("noise sd of way [mm]").fill("1e400")
    form.get_by_role("button", name="Make the case").click()
    expect(form.get_by_role("alert")).to_contain_text("noise sd of way [mm]: found 1e400, expected a number above 0")
    form.get_by_role("button", name="Discard").click()
    expect(form).to_have_count(0)
