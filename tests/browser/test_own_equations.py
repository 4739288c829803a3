"""A cart on a track, whose differential equations are typed into the mapper, up to the drag that they lack."""

from __future__ import annotations

import re

from carts import cart
from playwright.sync_api import Page, expect
from serving import Server
from test_workbench import drop, kept, serious

from tests.waiting import wait_for


def test_equations_of_a_cart_are_typed_and_their_missing_drag_is_found(page: Page, server: Server) -> None:
    drop(page, "cart.csv", cart())
    form = page.get_by_role("form", name="Map the columns")
    model = form.get_by_role("combobox", name=re.compile("^model"))
    expect(model.locator("option", has_text="your own differential equations")).to_have_count(1)
    model.select_option("ode")

    # what is proposed: a mass that the force drives
    expect(form.get_by_label("name of t [s]")).to_have_value("time")
    expect(form.get_by_label("state 1: unit")).to_have_value("mm")
    expect(form.get_by_label("state 2: derivative")).to_have_value("(force - d*v)/m")
    expect(form.get_by_label("measured 1: column")).to_have_value("position")
    expect(form).to_contain_text("become parameters to fit: d, m.")
    expect(page.locator("#command")).to_contain_text("--fit=d=1.0 --fit=m=1.0 --state=x=fit:mm")
    assert serious(page) == []

    # a time that is not mapped is said at once, and where the case is asked for
    make, alert = form.get_by_role("button", name="Make the case"), form.get_by_role("alert")
    form.get_by_label("name of t [s]").fill("t")
    form.get_by_label("state 1: unit").fill("m")
    expect(form).to_contain_text("time: no column is mapped to it, expected the one that tells when")
    make.click()
    expect(alert).to_contain_text("time: no column is mapped to it")
    form.get_by_label("name of t [s]").fill("time")
    form.get_by_label("state 2: unit").fill("m/s")
    expect(form.get_by_text("time: no column is mapped to it, expected")).to_have_count(1)  # that of the alert

    # by the keyboard: a state more, which is one too many, and what it held is asked for by name
    form.get_by_role("button", name="Add a state").press("Enter")
    expect(form.get_by_label("state 3: name")).to_be_focused()
    page.keyboard.type("v")
    form.get_by_label("state 3: derivative").fill("0")
    make.press("Enter")
    expect(alert).to_contain_text("state 3: found v once more, expected another name")
    form.get_by_role("button", name="Remove state 3").press("Enter")
    expect(form.get_by_role("button", name="Add a state")).to_be_focused()
    form.get_by_label("state 2: starts at").fill("rest")
    make.click()
    expect(alert).to_contain_text("v starts at: found rest, expected fit, a number or one of time, force, position")
    form.get_by_label("state 2: starts at").fill("0")

    # the mass is known; a name that leaves the formula for a key comes back with what was typed of it
    form.get_by_label("m is", exact=True).select_option("known")
    form.get_by_label("start value of m").fill("1,3")
    make.click()
    expect(alert).to_contain_text("start value of m: found 1,3, expected a number")
    form.get_by_label("start value of m").fill("1.3")
    form.get_by_label("unit of m", exact=True).fill("kg")
    form.get_by_label("state 2: derivative").fill("(force - d*v)/mass")
    expect(form).to_contain_text("become parameters to fit: d, mass.")
    form.get_by_label("state 2: derivative").fill("(force - d*v)/m")
    expect(form.get_by_label("unit of m", exact=True)).to_have_value("kg")
    form.get_by_label("min of d").fill("0")

    # kept over a reload
    wait_for(lambda: page.wait_for_timeout(50) or kept(server, "min_d") == "0")
    page.reload()
    expect(form.get_by_label("state 2: starts at")).to_have_value("0")
    expect(form.get_by_label("m is", exact=True)).to_have_value("known")
    expect(page.locator("#command")).to_contain_text("'--constant=m=1.3 kg' --fit=d=1.0:0.0: --state=x=fit:m")
    make.click()
    expect(page.locator(".below .panel", has_text="Parameters of the model")).to_contain_text("dv/dt =")
    expect(page.locator(".lead .chip")).to_have_text("something is missing")
    page.get_by_role("button", name="Discover").first.click()
    expect(page.locator(".lead")).to_contain_text("k*v**2 in derivative.v")
