"""Driving a simulated robot from the page: armed, run, stopped by space and by another page; parameters; a replay."""

from __future__ import annotations

import os
import re
import socket
import threading
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, TimeoutError, expect
from serving import Server

SHOTS = os.environ.get("TERRAPIN_SCREENSHOTS")


@pytest.fixture(scope="module", autouse=True)
def warm(server: Server) -> None:
    server.warm_live()


@pytest.fixture
def robot(page: Page, server: Server) -> Page:
    """The Live tab with a robot that lives on it."""
    server.ask("DELETE", "/api/live")  # else the name of the last test's robot passes for this one's
    page.get_by_role("link", name="Live").click()
    page.locator("#live-source").select_option("robot:floor")
    page.get_by_role("button", name="Watch", exact=True).click()
    expect(page.locator("#context")).to_have_text("simulated robot")
    return page


def findings(page: Page) -> list[str]:
    found = Axe().run(page).response["violations"]
    return [f"{v['id']}: {v['nodes'][0]['target']}: {v['help']}" for v in found]


def shot(page: Page, name: str) -> None:
    if SHOTS:
        Path(SHOTS).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=str(Path(SHOTS) / f"{name}.png"))


def arm(page: Page) -> None:
    """By the keyboard alone."""
    page.get_by_role("button", name="Arm …").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("dialog")).to_contain_text("Space stops it at once")
    page.keyboard.press("Enter")
    expect(page.get_by_role("dialog")).to_be_hidden()


def ready(page: Page) -> None:
    """Armed, without a fault."""
    if page.locator("[data-tile=Faults] .bad").count():
        page.get_by_role("button", name="Clear faults").click()
        expect(page.locator("[data-tile=Faults]")).to_contain_text("none")
    if page.get_by_role("button", name="Arm …").is_enabled():
        arm(page)


def runs(page: Page) -> None:
    """Armed and running. A machine that kept the page's heart waiting for 0.4 s has let go: then once more."""
    panel = page.locator(".drive-panel")
    for _ in range(20):
        ready(page)
        page.evaluate(
            """() => {
                const number = document.querySelector('.drive-panel input[type=number]');
                number.value = '0.3';
                number.dispatchEvent(new Event('change'));
                document.querySelector('.drive-panel button.main:not(dialog *)').click();
            }"""
        )
        with suppress(AssertionError):
            expect(panel).to_contain_text("run 0.30 m/s", timeout=5000)
            expect(page.locator("[data-tile=State]")).to_contain_text(re.compile("run|limiting"), timeout=5000)
            return
    raise AssertionError(panel.text_content())


def disarmed(page: Page) -> None:
    """By its button, found running: it is gone where the page has let go while the test looked elsewhere."""
    for _ in range(20):
        runs(page)
        with suppress(TimeoutError):
            page.get_by_role("button", name="Disarm").click(timeout=2000)
            expect(page.get_by_role("button", name="Arm …")).to_be_enabled()
            return
    raise AssertionError(page.locator(".drive-panel").text_content())


WRITTEN = """() => new Promise((done) => {
  const pen = CanvasRenderingContext2D.prototype, write = pen.fillText, said = [];
  pen.fillText = function (text, ...rest) { said.push(text); return write.call(this, text, ...rest); };
  setTimeout(() => { pen.fillText = write; done(said); }, 500);
})"""


def stopped(page: Page) -> None:
    expect(page.locator("[data-tile=Faults]")).to_contain_text("stop_all")
    expect(page.locator("[data-tile=State]")).to_contain_text("bridge off")


def test_arm_run_and_stop(robot: Page, server: Server, browser: Browser) -> None:
    """Armed and run, truth beside the estimate; space stops wherever the focus is; another page stops too."""
    page = robot
    expect(page.locator(".drive-panel")).to_contain_text("Nothing goes to the robot before you arm it")
    expect(page.locator("[data-tile='C_t, mN m'] dd").first).to_have_text("not valid")  # it stands still
    written = page.evaluate(WRITTEN)
    assert any(text.startswith("GROUND.torque   not valid   truth") for text in written), written
    assert "ground not known to the controller" in written
    page.get_by_label("Ground of the simulated robot").select_option("sand")
    runs(page)
    expect(page.locator(".drive-panel")).to_contain_text("Armed: this page drives")
    expect(page.locator(".drive-panel")).not_to_contain_text("before you arm it")
    page.get_by_label("Setpoint as a number").fill("5")
    page.get_by_label("Setpoint as a number").dispatch_event("change")
    expect(page.get_by_label("Setpoint as a number")).to_have_value("2.16")
    expect(page.locator(".tab-live > .notice")).to_contain_text(
        "found 5 m/s, expected at most 2.16 either way: 2.16 is"
    )
    page.evaluate("() => { const end = Date.now() + 1500; while (Date.now() < end); }")  # its heart stands still
    expect(page.locator(".tab-live > .notice")).to_contain_text("No longer armed: nothing heard of the page")
    runs(page)
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    expect(page.get_by_role("button", name="Stop", exact=True)).to_be_in_viewport(ratio=1)
    page.evaluate("scrollTo(0, 0)")
    expect(page.locator(".signal-table tr", has_text="TRUTH.torque").locator(".n")).not_to_have_text("0")
    page.keyboard.press("p")
    expect(page.get_by_role("button", name="Go on")).to_be_visible()
    page.keyboard.press("p")
    assert findings(page) == []
    shot(page, "live-driving")
    if page.get_by_role("button", name="Run", exact=True).or_(page.get_by_role("button", name="Halt")).is_hidden():
        runs(page)  # axe takes the page's only thread for longer than its heart may wait
    page.get_by_label("Words of the mark").focus()
    page.keyboard.press("Space")
    stopped(page)
    expect(page.get_by_label("Words of the mark")).to_have_value("mark")
    expect(page.get_by_role("button", name="Run", exact=True)).to_be_hidden()
    expect(page.locator(".fault-list")).to_contain_text("Release the stop")
    page.wait_for_timeout(1000)  # in which the button does not let go
    page.get_by_role("button", name="Release the stop").click()
    expect(page.locator("[data-tile=Faults]")).to_contain_text("none")
    runs(page)
    context = browser.new_context(viewport={"width": 390, "height": 844})
    other = context.new_page()
    other.goto(server.line)  # the workbench: the stop is in its head
    other.get_by_role("button", name="Stop", exact=True).click()
    stopped(page)
    expect(other.get_by_role("button", name="Stopped")).to_be_visible()
    context.close()
    page.wait_for_timeout(1000)
    page.get_by_role("button", name="Release the stop").click()
    expect(page.get_by_role("button", name="Stop", exact=True)).to_be_visible()


def test_clearing_halts_what_ran(robot: Page) -> None:
    """A clear starts nothing: the page that drives asks for idle with it, stays armed, and Run runs again."""
    runs(robot)
    robot.get_by_role("button", name="Clear faults").click()
    expect(robot.locator("[data-tile=State]")).to_contain_text("bridge off")
    expect(robot.locator("[data-tile=Faults]")).to_contain_text("none")
    expect(robot.get_by_role("button", name="Run", exact=True)).to_be_visible()
    runs(robot)


def test_a_page_that_is_closed_drives_no_more(robot: Page, server: Server, browser: Browser) -> None:
    context = browser.new_context()
    other = context.new_page()
    other.goto(f"{server.line}#live")
    expect(other.locator("#context")).to_have_text("simulated robot")
    runs(other)
    context.close()
    expect(robot.locator("[data-tile=Faults]")).to_contain_text("command_timeout")
    expect(robot.locator("[data-tile=State]")).to_contain_text("bridge off")
    expect(robot.locator(".event", has_text="no more commands").first).to_be_visible()
    robot.get_by_role("button", name="Clear faults").click()
    expect(robot.locator("[data-tile=Faults]")).to_contain_text("none")


def test_parameters_in_the_page(robot: Page) -> None:
    robot.get_by_role("button", name="Read all").click()
    expect(robot.get_by_text("all at their defaults")).to_be_visible()
    robot.get_by_label("Filter parameters").fill("window")
    robot.get_by_label("window in ms", exact=True).fill("ten")
    robot.keyboard.press("Enter")
    expect(robot.locator(".tab-live .notice")).to_contain_text("expected a number in ms")
    robot.get_by_label("window in ms", exact=True).fill("600")
    robot.keyboard.press("Enter")
    expect(robot.get_by_text("not at their default: window")).to_be_visible()
    expect(robot.locator("#command")).to_contain_text("terrapin param")
    assert findings(robot) == []


def test_a_replay_says_so_and_seeks(page: Page, server: Server) -> None:
    lines = [f"({i / 100:.6f}) can0 183#{i:04X}334455667700" for i in range(6000)]
    (server.workspace / "logs" / "minute.log").write_text("\n".join(lines) + "\n")
    page.get_by_role("link", name="Live").click()
    page.locator("#live-source").select_option("log:minute.log")
    page.get_by_role("button", name="Watch", exact=True).click()
    expect(page.locator(".live-bar .chip")).to_have_text("replay")
    expect(page.get_by_text("This is a replay")).to_be_visible()
    expect(page.locator(".replay-bar output")).to_contain_text("of 60.0 s")
    page.get_by_label("Place in the log").fill("50")
    expect(page.locator(".replay-bar output")).to_contain_text(re.compile(r"^5\d\.\d of"))
    page.get_by_label("Speed of the replay").select_option("10")
    page.get_by_label("loop").check()
    expect(page.locator(".replay-bar output")).to_contain_text(re.compile(r"^[1-4]?\d\.\d of"))
    expect(page.locator(".live-bar .chip")).to_have_text("replay")
    assert findings(page) == []
    page.get_by_role("button", name="Leave").click()
    expect(page.locator(".replay-bar")).to_be_hidden()


def test_a_calibration_is_led(robot: Page) -> None:
    """Step by step to what it found, with two speeds in the place of three."""
    robot.get_by_role("button", name="Read all").click()
    robot.get_by_label("calibrate_steps", exact=True).fill("2")
    robot.keyboard.press("Enter")
    expect(robot.get_by_text("not at their default: calibrate_steps")).to_be_visible()
    steps = robot.locator(".led li")
    for _ in range(20):  # as `runs`
        ready(robot)
        with suppress(AssertionError):
            robot.get_by_role("button", name="Calibrate").click(timeout=5000)
            expect(steps.nth(1)).to_contain_text("of 2 finished", timeout=5000)
            expect(steps.nth(0)).to_have_class("good")
            expect(steps.nth(2)).to_contain_text(re.compile(r"Found: \d.* mN m"), timeout=40_000)
            break
    else:
        raise AssertionError(robot.locator(".drive-panel").text_content())
    expect(robot.locator("[data-tile=State]")).to_contain_text("bridge off")


def commands(page: Page) -> int:
    """How many went out, as a page that does not drive is told."""
    return int(page.evaluate(SENT))


SENT = """() => new Promise((done, failed) => {
  const token = sessionStorage.getItem('terrapin-token');
  const socket = new WebSocket(`ws://${location.host}/api/live/socket?token=${token}`);
  socket.onerror = failed;
  socket.onmessage = (message) => {
    if (typeof message.data !== 'string') return;
    const said = JSON.parse(message.data);
    if (said.type === 'status') { socket.close(); done(said.drive.sent); }
  };
})"""


class Wire(threading.Thread):
    """Hands bytes on between browser and server until it is cut, after which nothing passes and nothing is closed."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._to, self.whole = port, True
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self.start()

    def run(self) -> None:
        with suppress(OSError):
            while True:
                near, far = self._listening.accept()[0], socket.create_connection(("127.0.0.1", self._to))
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                if self.whole:
                    sink.sendall(data)
            sink.close()

    def close(self) -> None:
        self._listening.close()


@pytest.mark.parametrize("how", ["hidden", "asleep", "cut off"])
def test_a_page_that_sleeps_or_is_cut_off_drives_no_more(
    robot: Page, server: Server, browser: Browser, how: str
) -> None:
    """The last command goes out within 0.5 s; then the controller's own time-out puts the bridge off. `hidden`: another
    tab is looked at; `asleep`: its timers stand still; `cut off`: its bytes get lost, and nobody closes anything."""
    context, wire = browser.new_context(), Wire(server.port)
    other = context.new_page()
    other.goto(f"{server.line.replace(str(server.port), str(wire.port))}#live")
    expect(other.locator("#context")).to_have_text("simulated robot")
    runs(other)
    if how == "hidden":
        other.evaluate(
            """() => {
                Object.defineProperty(document, 'hidden', { value: true });
                document.dispatchEvent(new Event('visibilitychange'));
            }"""
        )
    elif how == "asleep":
        context.new_cdp_session(other).send("Emulation.setVirtualTimePolicy", {"policy": "pause"})
    else:
        wire.whole = False
    robot.wait_for_timeout(500)
    last = commands(robot)
    robot.wait_for_timeout(500)
    assert commands(robot) == last
    expect(robot.locator("[data-tile=Faults]")).to_contain_text("command_timeout")
    expect(robot.locator("[data-tile=State]")).to_contain_text("bridge off")
    expect(robot.locator(".event", has_text="no more commands").first).to_be_visible()
    context.close()
    wire.close()
    robot.get_by_role("button", name="Clear faults").click()
    expect(robot.locator("[data-tile=Faults]")).to_contain_text("none")


def test_two_people_at_one_robot(robot: Page, server: Server, browser: Browser) -> None:
    """The second is told in one line, may stop, and drives once the first has disarmed; nobody reloads."""
    context = browser.new_context()
    other = context.new_page()
    other.goto(f"{server.line}#live")
    expect(other.locator("#context")).to_have_text("simulated robot")
    runs(robot)
    expect(other.locator(".drive-panel")).to_contain_text("Another page drives. Stop works here all the same.")
    expect(other.get_by_role("button", name="Arm …")).to_be_disabled()
    disarmed(robot)
    expect(other.get_by_role("button", name="Arm …")).to_be_enabled()
    runs(other)
    expect(robot.locator(".drive-panel")).to_contain_text("Another page drives.")
    robot.get_by_role("button", name="Stop", exact=True).click()
    stopped(other)
    expect(other.locator(".drive-panel")).to_contain_text("Release the stop, then arm again")
    expect(other.locator(".tab-live > .notice")).to_be_hidden()
    robot.wait_for_timeout(1000)
    robot.get_by_role("button", name="Release the stop").click()
    runs(other)
    context.close()
    expect(robot.locator("[data-tile=State]")).to_contain_text("bridge off")
    robot.get_by_role("button", name="Clear faults").click()
    expect(robot.locator("[data-tile=Faults]")).to_contain_text("none")


def test_a_controller_that_vanishes_while_driving(robot: Page, server: Server) -> None:
    """Said where it happened; Watch finds it again, and it is driven without a reload."""
    runs(robot)
    [alive] = [p for p in psutil.Process(server.process.pid).children(recursive=True) if "sim" in p.cmdline()]
    alive.kill()
    expect(robot.locator(".live-bar .chip")).to_have_text("gone")
    expect(robot.locator(".tab-live > .notice")).to_contain_text("Watch connects again")
    expect(robot.get_by_role("button", name="Arm …")).to_be_disabled()
    expect(robot.locator(".drive-panel .form")).to_be_hidden()
    robot.get_by_role("button", name="Watch", exact=True).click()
    expect(robot.locator(".live-bar .chip")).to_have_text("live")
    disarmed(robot)
