"""Live and Simulate as a user goes through them: pictures counted against what was sent, record, stop, roll, keep."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, Route, expect
from serving import Server

sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))

from slcan_feeder import Feeder

from terrapin_hil.messages import interface
from terrapin_hil.nodes import Node, node_count
from terrapin_tools.logs.reading import read_log
from terrapin_tools.workbench.story.sentences import amount
from terrapin_tools.workbench.story.story import Value

SERIOUS = ("serious", "critical")


@pytest.fixture(scope="module", autouse=True)
def warm(server: Server) -> None:
    server.warm_live()


def serious(page: Page) -> list[str]:
    """What axe finds that would keep somebody from using the page."""
    found = Axe().run(page).response["violations"]
    return [f"{v['id']}: {v['nodes'][0]['target']}: {v['help']}" for v in found if v["impact"] in SERIOUS]


def said(page: Page) -> dict[str, Any]:
    """Counts that the Live tab keeps beside the picture."""
    found = page.eval_on_selector(".tab-live", "e => ({...e.dataset})")
    assert isinstance(found, dict)
    return found


def wait_for(page: Page, name: str, value: str) -> None:
    expect(page.locator(".tab-live")).to_have_attribute(f"data-{name}", value)


def test_full_bus_is_counted_and_recorded(page: Page, server: Server) -> None:
    """8,000 frames/s over a pty for some seconds: each frame in a picture and in the log (a minute: bench_live.py)."""
    seconds = 3.0
    page.get_by_role("link", name="Live").click()
    expect(page.get_by_text("nothing is watched", exact=True)).to_be_visible()
    with Feeder(8000, seconds, held=True) as feeder:
        page.locator("#live-source").select_option("typed")
        page.locator("#live-typed").fill(f"serial:{feeder.path}")
        page.locator("#live-bitrate").select_option("1000000")
        page.get_by_role("button", name="Watch").click()
        expect(page.locator("#command")).to_contain_text(f"terrapin monitor --link serial:{feeder.path}")
        page.get_by_label("Name of the log").fill("browser_full")
        page.get_by_role("button", name="Record", exact=True).click()
        expect(page.locator("#command")).to_contain_text("terrapin log record ")
        feeder.go()
        wait_for(page, "total", str(int(8000 * seconds)))
        wait_for(page, "frames", str(int(8000 * seconds)))
        counts = said(page)
        assert (counts["missed"], counts["lost"]) == ("0", "0")
        page.wait_for_function(
            "Number(document.querySelector('.tab-live').dataset.redraws) > 5"
        )  # how many a second: bench_live.py, on a machine with nothing else to do
        assert 0 < page.locator(".event").count() <= 100  # of some 2,000: the fed state changes with each frame
        page.get_by_role("button", name="End the log").click()
        expect(page.get_by_text("it is among the sources now")).to_be_visible()
    wait_for(page, "state", "gone")
    expect(page.locator(".tab-live .notice")).to_contain_text("the bus went away")
    log, cut = read_log(server.workspace / "logs" / "browser_full.mf4")
    assert cut == ""
    numbers = [int.from_bytes(log.payload(row)[:4], "little") for row in range(len(log))]
    assert numbers == list(range(int(8000 * seconds)))
    assert serious(page) == []


def test_live_left_while_it_connects_and_shown_again(page: Page) -> None:
    """Nobody is told of it (the page's console stays empty), nothing goes on behind the page, and Live works again."""
    page.evaluate(
        """() => {
            let sockets = 0;
            window.WebSocket = class extends window.WebSocket {
                constructor(...all) {
                    super(...all);
                    const name = `socket${++sockets}`;
                    for (const event of ['open', 'close'])
                        this.addEventListener(event, () => { document.documentElement.dataset[name] = event; });
                    if (sockets === 1) location.hash = '#workbench'; // before it can be open
                }
            };
        }"""
    )
    for socket, event in (("socket1", "close"), ("socket2", "open")):
        page.get_by_role("link", name="Live").click()
        expect(page.locator("html")).to_have_attribute(f"data-{socket}", event)


def test_all_controllers_on_a_bus_and_one_of_them(page: Page, server: Server) -> None:
    """A log of two nodes: a row for each, and a button that watches the other one."""
    message = interface().messages["MOTION"]
    rows = [Node(n).to_bus((message.id, message.encode({"slip": slip})[0])) for n, slip in ((0, 100), (3, 250))]
    lines = [f"({i * 0.001:.6f}) can0 {rows[i % 2][0]:03X}#{rows[i % 2][1].hex()}" for i in range(100)]
    (server.workspace / "logs" / "two.log").write_text("\n".join(lines) + "\n")
    page.get_by_role("link", name="Live").click()
    page.locator("#live-source").select_option("log:two.log")
    page.get_by_role("button", name="Watch", exact=True).click()
    nodes = page.locator(".nodes")
    expect(nodes.get_by_role("row")).to_have_text(
        [re.compile("node"), re.compile("0.*0.10.*watched"), re.compile("3.*0.25")]
    )
    nodes.get_by_role("button", name="Watch node 3").click()
    expect(page.locator("#command")).to_contain_text("--node 3")
    expect(nodes.get_by_role("row").nth(2)).to_have_text(re.compile("3.*0.25.*watched"))
    expect(page.locator("#live-node")).to_have_value("3")
    numbers = [f"node {n}" for n in range(node_count())]
    expect(page.locator("#live-node option")).to_have_text(["node of the link", *numbers])
    assert serious(page) == []
    page.get_by_role("button", name="Leave").click()
    expect(nodes).to_be_hidden()


def test_the_tab_waits_for_its_style(page: Page) -> None:
    """A sheet that came after the tab moved rows from under the hand that was about to drag them."""
    held: list[Route] = []
    page.route("**/live.css", lambda route: held.append(route))
    with page.expect_request("**/live.css"):
        page.get_by_role("link", name="Live").click()
    grid = page.locator(".live-grid")
    page.wait_for_timeout(500)
    assert not grid.is_visible()
    held[0].continue_()
    expect(grid).to_be_visible()
    assert grid.evaluate("(one) => getComputedStyle(one).display") == "grid"


def test_a_signal_is_dragged_into_the_charts_and_the_layout_kept(page: Page, server: Server) -> None:
    """By name, in this browser: a reload knows it, and it brings back what was drawn."""
    assert server.ask("POST", "/api/live", {"source": "simulator:steady_sand"}).status == 200
    page.get_by_role("link", name="Live").click()
    page.get_by_label("Filter signals").fill("duty|slip$")
    box = page.get_by_label("Plot ACTUATE.duty")
    expect(box).not_to_be_checked()
    page.get_by_role("row", name="ACTUATE.duty").drag_to(page.locator(".strip-charts"))
    expect(box).to_be_checked()
    page.get_by_label("Seconds shown").select_option("60")
    page.get_by_label("Name of the layout").fill("with duty")
    page.get_by_role("button", name="Keep the layout").click()
    page.reload()
    page.get_by_label("Filter signals").fill("duty|slip$")
    box.uncheck()
    page.get_by_label("Layout", exact=True).select_option("with duty")
    expect(box).to_be_checked()
    expect(page.get_by_label("Seconds shown")).to_have_value("60")
    assert serious(page) == []
    page.get_by_role("button", name="Drop the layout").click()
    expect(page.get_by_label("Layout", exact=True)).to_have_text("layout …")
    page.get_by_role("button", name="Leave").click()


def test_numbers_have_the_digits_of_their_sd(page: Page) -> None:
    """As the terminal and a report have them; without an sd four digits, and a prefix of the unit."""
    found = page.evaluate(
        """async (all) => {
            const { quantity } = await import('/static/plots/basics.js');
            return all.map(([value, unit, sd]) => quantity(value, unit, sd));
        }""",
        [[0.1701234, "N m", 0.0053], [0.01206, "N m", 0.00012], [-7.2e-6, "N m", 0], [123456.0, "Pa", 700.0]],
    )
    assert found == ["0.1701 ± 0.0053 N m", "12.06 ± 0.12 mN m", "\N{MINUS SIGN}7.2 µN m", "123.46 ± 0.70 kPa"]
    told = [amount(Value(0.01206, 0.00012, "N m")), amount(Value(123456.0, 700.0, "Pa"))]
    assert found[1::2] == told


BARS = """async ([points, begin, end, width, steps]) => {
    const { Ring, columns, bars } = await import('/static/strip.js');
    const ring = new Ring();
    for (const [time, value] of points) ring.push(time, value);
    return bars(columns(ring, begin, end, width), steps).map((b) => [b.x, b.wide, b.low, b.high]);
}"""


def test_lines_are_drawn_as_bars(page: Page) -> None:
    """Bars cost the processor a twentieth of a stroked path through a noisy signal, and lose no spike."""

    def bars(points: list[tuple[float, float]], width: int, steps: bool = False, begin: float = 0.0) -> list[Any]:
        found = page.evaluate(BARS, [points, begin, points[-1][0], width, steps])
        assert isinstance(found, list)
        edges = [(x, x + wide) for x, wide, _, _ in found]
        assert edges[0][0] >= 0
        assert [a for _, a in edges[:-1]] == [b for b, _ in edges[1:]]  # no gap, nothing drawn twice
        return found

    noisy = [(i / 4000, float((i * 7919) % 1009)) for i in range(4001)]  # 40 points a pixel
    found = bars([*noisy[:2000], (0.5, 5000.0), *noisy[2001:]], 100)
    assert len(found) == 101
    assert max(high for _, _, _, high in found) == 5000.0
    assert all(high - low > 900 for _, _, low, high in found)
    ramp = bars([(0.0, 0.0), (1.0, 10.0)], 10)  # two points, ten pixels: each bar takes its part of the slope
    assert [(low, high) for _, _, low, high in ramp] == [(max(0.0, k - 0.5), min(10.0, k + 0.5)) for k in range(11)]
    assert bars([(0.0, 1.0), (0.5, 3.0), (1.0, 3.0)], 10, steps=True) == [
        [0, 5, 1.0, 1.0],
        [5, 1, 1.0, 3.0],
        [6, 5, 3.0, 3.0],
    ]
    far = bars([(0.0, 0.0), (1e6, 1.0)], 10, begin=1e6 - 1.0)  # the point before lies ten million pixels to the left
    assert len(far) <= 11


EVENTS = """async (batches) => {
    const { Events } = await import('/static/live/events.js');
    const events = new Events(), found = [];
    for (const numbers of batches) {
        events.take(numbers.map((number) => ({ number, time: number / 10, kind: 'mark', text: `event ${number}` })));
        events.listed = -Infinity; // whatever the time since it last looked
        events.draw(0);
        found.push([...events.log.children].map((row) => Number(row.lastChild.textContent.split(' ')[1])));
    }
    return found;
}"""


def test_every_event_is_listed_once_and_the_newest_first(page: Page) -> None:
    """What is told again, or once more beside newer ones, is not listed twice; a full list keeps the newest 100."""
    batches = [[1, 2, 3], [2, 3], [3, 4], list(range(5, 205)), [205]]
    first, again, more, full, last = page.evaluate(EVENTS, batches)
    assert first == again == [3, 2, 1]
    assert more == [4, 3, 2, 1]
    assert full == list(range(204, 104, -1))
    assert last == list(range(205, 105, -1))


ROLLED = """async (looks) => {
    const { Rolling } = await import('/static/rolling.js');
    const names = ['ATTITUDE.angle', 'ATTITUDE.swing_angle', 'ATTITUDE.pitch', 'ATTITUDE.pitch_valid',
        'MOTION.ground_speed', 'MOTION.slip', 'MOTION.slip_valid', 'STATUS.state', 'GROUND.terrain'];
    const rolling = new Rolling();
    rolling.begin({ radius: 0.08 }, names.map((name) => ({ name })));
    rolling.take((name) => ({ at: (time) => (name === 'MOTION.ground_speed' ? 0.5 : 0) }));
    return looks.map(([end, cursor]) => {
        rolling.drawn = -Infinity; // whatever the time since the last picture
        rolling.draw(end, cursor);
        return rolling.way;
    });
}"""


def test_the_way_goes_on_wherever_somebody_points(page: Page) -> None:
    """It is that of the robot, not of the time that is looked at; over a gap it is not guessed."""
    looks = [(0.2, None), (0.4, 0.1), (0.6, 0.1), (0.8, None), (3.0, None), (3.2, 2.0)]
    assert page.evaluate(ROLLED, looks) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.4, 0.5])


ASKED = """async () => {
    const { Replay } = await import('/static/live/replay.js');
    const asked = [];
    const app = { api: (path, { body }) => { asked.push([path, body]); } };
    const replay = new Replay({ app, run: (work) => work() });
    const now = { position: 2, length: 60, speed: 5, loop: true };
    replay.draw({ replay: now });
    const shown = [replay.place, replay.speed].map((one) => one.value).concat(replay.loop.checked, replay.said.value);
    replay.loop.checked = false;
    replay.speed.value = '0.5';
    replay.place.value = '30';
    for (const one of [replay.loop, replay.speed, replay.place]) one.dispatchEvent(new Event('change'));
    return [shown, asked];
}"""


def test_a_replay_is_asked_for_what_is_chosen(page: Page) -> None:
    shown, asked = page.evaluate(ASKED)
    assert shown == ["2", "5", True, "2.0 of 60.0 s"]
    assert asked == [["live/replay", body] for body in ({"loop": False}, {"speed": 0.5}, {"position": 30})]


def test_simulator_signals_events_and_stop(page: Page, server: Server) -> None:
    page.get_by_role("link", name="Live").click()
    page.locator("#live-source").select_option("simulator:slope_limiter")
    page.locator("#live-controller").select_option("pty")
    page.get_by_role("button", name="Watch").click()
    expect(page.locator(".event.state").first).to_be_visible()
    expect(page.locator("[data-tile=State]")).to_contain_text(re.compile("run|limiting|stuck"))
    expect(page.locator(".signal-table tbody tr").first).not_to_contain_text(re.compile("COMMAND|STOP_ALL"))
    page.get_by_label("Filter signals").fill("torque|duty")
    expect(page.locator(".signal-table tbody tr")).to_have_count(4)
    page.get_by_label("Filter signals").fill("torque[")  # no regular expression yet: the last good one stays
    expect(page.locator(".signal-table tbody tr")).to_have_count(4)
    page.get_by_label("Filter signals").fill("duty")
    page.get_by_label("Plot ACTUATE.duty").check()
    page.get_by_label("Words of the mark").fill("here")
    page.get_by_role("button", name="Mark", exact=True).click()
    expect(page.locator(".event.mark")).to_contain_text("here")
    page.get_by_role("button", name="Pause").click()
    expect(page.get_by_role("button", name="Go on")).to_have_attribute("aria-pressed", "true")
    page.locator(".strip-charts canvas").focus()
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_text("cursor at")).to_be_visible()
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    expect(page.locator(".drive-panel")).to_contain_text("opens the emergency stop of the simulated robot")
    page.evaluate(  # pressed, and pressed again as soon as the button has become the one that lets go
        """() => {
            const stop = document.querySelector('button.stop');
            new MutationObserver((_, seen) => {
                if (stop.getAttribute('aria-pressed') !== 'true') return;
                seen.disconnect();
                stop.click();
            }).observe(stop, { attributes: true });
            stop.click();
        }"""
    )
    expect(page.locator("[data-tile=Faults]")).to_contain_text("estop")
    expect(page.locator("[data-tile=State]")).to_contain_text("bridge off")
    page.wait_for_timeout(1000)  # in which it does not let go
    page.get_by_role("button", name="Release the stop").click()
    expect(page.get_by_role("button", name="Stop", exact=True)).to_be_visible()
    assert said(page)["missed"] == "0"
    assert serious(page) == []
    page.get_by_role("button", name="Light").or_(page.get_by_role("button", name="Switch between")).click()
    assert serious(page) == []


def test_second_browser_and_reload_see_the_same(page: Page, server: Server, browser: Browser) -> None:
    assert server.ask("POST", "/api/live", {"source": "simulator:steady_sand"}).status == 200
    page.get_by_role("link", name="Live").click()
    expect(page.locator("#context")).to_have_text("simulator: steady_sand")
    expect(page.locator(".event.state").first).to_be_visible()
    page.reload()
    expect(page.locator("#context")).to_have_text("simulator: steady_sand")
    expect(page.locator(".event.state").first).to_be_visible()  # what happened before the reload is there
    context = browser.new_context(viewport={"width": 820, "height": 1180})  # a tablet
    other = context.new_page()
    other.goto(f"{server.line}#live")
    expect(other.locator("#context")).to_have_text("simulator: steady_sand")
    wide = other.evaluate("document.documentElement.scrollWidth - innerWidth")
    assert wide <= 0
    page.get_by_role("button", name="Leave").click()
    expect(other.get_by_text("nothing is watched", exact=True)).to_be_visible()
    expect(other.locator(".health")).to_have_text("Nothing is watched.")
    assert other.get_by_label("Load of the bus").evaluate("bar => bar.value") == 0
    expect(other.locator(".drive-panel details")).to_be_hidden()
    context.close()


def test_bad_files(page: Page, server: Server, tmp_path: Path) -> None:
    """A file that is no log, and a DBC that does not fit: one clear line in the page, which goes on."""
    (tmp_path / "junk.mf4").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "other.dbc").write_text('VERSION ""\nBU_: A\nBO_ 5 M: 8 A\n SG_ a : 0|8@1+ (1,0) [0|0] "V" A\n')
    (tmp_path / "drive.log").write_text("".join(f"({i / 1000:.6f}) can0 183#0011223344556677\n" for i in range(200)))
    page.get_by_role("link", name="Live").click()
    page.locator("#live-file").set_input_files(tmp_path / "drive.log")
    expect(page.locator("#live-source option", has_text="drive.log")).to_have_count(1)
    page.locator("#live-file").set_input_files(tmp_path / "other.dbc")
    expect(page.locator("#live-dbc option", has_text="other.dbc")).to_have_count(1)
    page.get_by_role("button", name="Watch").click()
    expect(page.locator(".tab-live .notice")).to_contain_text("the DBC knows 0 of 200 frames")
    wait_for(page, "state", "over")


def test_a_batch_says_why_it_did_not_begin_and_what_can_be_varied(page: Page) -> None:
    """The line stands in its panel and stays; the first field that is offered runs with success, its labels whole."""
    page.get_by_role("link", name="Simulate").click()
    panel = page.locator(".sim-batches")
    expect(panel).to_contain_text("one of its 5 checks does not hold. They were written for the scenario as shipped")
    page.get_by_label("Seeds").fill("1:4")
    vary = page.get_by_label("Varied, one field a line")
    vary.fill("supply=9V:12V")
    page.get_by_role("button", name="Run as a batch").click()
    expect(panel.get_by_role("alert")).to_contain_text("--vary supply")
    expect(page.get_by_role("button", name="Run as a batch")).to_be_enabled()
    expect(panel).to_contain_text("No batches yet")  # it was looked for: the line stays all the same
    expect(panel.get_by_role("alert")).to_contain_text("expected a table")
    vary.fill("")
    offered = page.get_by_label("Add a field that is varied")
    expect(offered).to_contain_text("supply.voltage: now 12 V")
    offered.select_option(index=1)
    expect(vary).to_have_value(vary.get_attribute("placeholder") or "none")
    page.get_by_role("button", name="Run as a batch").click()
    expect(panel).to_contain_text("0 of 4 failed")
    expect(panel.get_by_role("alert")).to_be_hidden()
    page.get_by_label("Batch: up").select_option("mean(contact_torque[8:])")
    expect(panel.get_by_role("img")).to_have_accessible_name(re.compile("contact_torque.* up"))
    lefts = page.eval_on_selector_all(".batch-label", "all => all.map((one) => one.getBBox().x)")
    assert len(lefts) == 4
    assert min(lefts) >= 0
    assert serious(page) == []


def test_sliders_hold_what_is_set_for_a_robot_of_more_volts(page: Page) -> None:
    """One of 15.9 V stood at its end of 12 V, and a supply of 24 V at 20 V; a fault of the supply ended at 20 V."""

    def of_24_volts(route: Route) -> None:
        answer = route.fetch()
        told = answer.json()
        for scenario in told["scenarios"]:
            scenario["supply"] = 24.0
            for order in scenario["orders"]:
                order["setpoint"] = 15.9 if order["control"] == "voltage" else 2.4
        route.fulfill(response=answer, json=told)

    page.route("**/api/scenarios", of_24_volts)
    page.get_by_role("link", name="Simulate").click()
    page.locator("#sim-scenario").select_option("steady_sand")
    expect(page.get_by_label("voltage from 0 s")).to_have_value("15.9")
    expect(page.get_by_label("supply", exact=True)).to_have_value("24")
    page.get_by_label("Add a fault …").select_option("supply")
    expect(page.get_by_label("value")).to_have_attribute("max", "36")
    page.get_by_label("value").fill("30.06")
    expect(page.get_by_label("value")).to_have_value("30.06")
    page.locator("#sim-scenario").select_option("speed_control")
    expect(page.get_by_label("speed from 0 s")).to_have_value("2.4")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_run_rolls_and_is_kept(page: Page, server: Server, scheme: str) -> None:
    page.emulate_media(color_scheme=scheme)
    page.get_by_role("link", name="Simulate").click()
    page.locator("#sim-scenario").select_option("slope_limiter")
    page.get_by_label("slope from 1.5 m").fill("4")
    page.get_by_label("Ground from 1.5 m").select_option("agricultural")
    page.get_by_label("Add an effect …").select_option("stribeck")
    page.get_by_label("Add a fault …").select_option("supply")
    page.get_by_label("duration").fill("6")
    assert serious(page) == []
    page.get_by_role("button", name="Run", exact=True).click()
    expect(page.locator("#command")).to_contain_text(re.compile(r"terrapin run .*slope_limiter\.toml --out "))
    expect(page.get_by_label("Moment")).to_be_enabled()
    expect(page.locator(".play output")).to_contain_text("0.00 s")  # reduced motion: it waits to be played
    before = page.locator(".robot canvas").screenshot()
    page.get_by_label("Moment").fill("3")
    expect(page.locator(".play output")).to_contain_text("3.00 s")
    expect(page.get_by_text("state run")).to_be_visible()
    assert page.locator(".robot canvas").screenshot() != before
    page.get_by_role("button", name="Play").click()
    expect(page.locator(".play output")).not_to_contain_text("3.00 s")
    page.get_by_role("button", name="Pause").click()
    assert serious(page) == []
    page.get_by_label("Name of the case").fill(f"rolled_{scheme}")
    page.get_by_role("button", name="Keep as a case").click()
    expect(page.get_by_role("link", name=f"rolled_{scheme}")).to_be_visible()
    assert (server.workspace / "cases" / f"rolled_{scheme}" / "case.toml").is_file()
    scenario = next((server.workspace / "runs").glob("slope_limiter-*/slope_limiter.toml")).read_text()
    assert "stribeck" in scenario
    assert 'terrain = "agricultural"' in scenario

    own = page.locator("tr[data-run][aria-current]")  # of the runs that is shown, which is in the case in any case
    expect(own).to_have_count(1)
    expect(own.get_by_role("checkbox")).to_be_checked()
    expect(own.get_by_role("checkbox")).to_be_disabled()
    others = page.locator("tr[data-run]:not([aria-current])")
    if scheme == "dark":  # the first one's, from the server that both have
        [mine, earlier] = [str(one.get_attribute("data-run")) for one in (own, others.first)]
        expect(others.first.get_by_role("checkbox")).not_to_be_checked()
        others.first.get_by_role("button", name=earlier, exact=True).click()
        expect(page.locator(f"tr[data-run='{earlier}']")).to_have_attribute("aria-current", "")
        expect(own).to_have_count(1)
        expect(page.locator(f"tr[data-run='{mine}'] input")).not_to_be_checked()
        expect(page.locator(f"tr[data-run='{mine}'] input")).to_be_enabled()
        page.get_by_role("button", name=f"Remove {mine}").click()
        expect(page.locator(f"tr[data-run='{mine}']")).to_have_count(0)
        expect(page.locator(f"tr[data-run='{earlier}']")).to_have_count(1)
