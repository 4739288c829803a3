"""The chapters of the demonstration, in order. Each runs something real and says what came out, good or bad."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cantools
import numpy as np

from terrapin_hil import paths
from terrapin_hil.run.run import Result, run
from terrapin_hil.scenario.scenario import Scenario, find_scenario, load_scenario
from terrapin_tools.demo import figures, workbench
from terrapin_tools.demo.page import Chapter, write_page
from terrapin_tools.demo.stage import Stage
from terrapin_tools.papers.part import Table

__all__ = ["Demo"]


@dataclass
class Demo:
    """What earlier chapters leave for later ones."""

    stage: Stage
    chapters: list[Chapter] = field(default_factory=list)
    floor_to_sand: Result | None = None

    def play(self) -> Path:
        """All chapters; returns the page."""
        steps = (self.rolling, self.estimator, self.limiter, self.log, self.forced_slip, self.heated)
        for number, step in enumerate(steps, 1):
            chapter = Chapter(step.__doc__.strip().rstrip(".") if step.__doc__ else "")
            self.stage.say(f"\n{number}/{len(steps)} {chapter.title}")
            step(chapter)
            self.chapters.append(chapter)
        page = self.stage.out / "index.html"
        summary = "Made by `terrapin demo`: every number and picture comes from the runs of this page."
        write_page(page, "Terrapin: a robot that feels the ground", summary, self.chapters)
        return page

    def _run(self, name: str, link: str = "inprocess", folder: str | None = None, **changes: Any) -> Result:
        scenario: Scenario = replace(load_scenario(find_scenario(name)), **changes)
        if folder is None:
            return run(scenario, link, progress=self.stage.progress)
        return workbench.logged_run(scenario, link, self.stage.out / "runs" / folder, self.stage.progress)

    def rolling(self, chapter: Chapter) -> None:
        """The firmware as a process, the robot rolls from a hard floor onto dry sand"""
        begin = time.monotonic()
        result = self.floor_to_sand = self._run("floor_to_sand", "pty", "floor_to_sand")
        seconds = time.monotonic() - begin
        on_sand = result.truth["segment"] == 1
        self.stage.tell(
            chapter,
            "The controller runs as a process of its own and speaks SLCAN on a pseudo-terminal, as a board on USB "
            "would; the simulated robot (R = 80 mm, r = 18 mm) gives it ADC codes and encoder counts and obeys its "
            "bridge duty, one exchange a millisecond.",
        )
        ticks = len(result.time)
        self.stage.tell(
            chapter,
            f"{ticks} ticks in lockstep in {seconds:.1f} s ({ticks / seconds:.0f} ticks/s). On the sand from "
            f"{result.time[np.argmax(on_sand)]:.2f} s on; final speed {result.truth['speed'][-1]:.3f} m/s.",
        )
        chapter.commands.append("terrapin run floor_to_sand --link pty --out out/runs/floor_to_sand")

    def estimator(self, chapter: Chapter) -> None:
        """The controller calibrates its friction on the floor and feels the sand"""
        result = self.floor_to_sand
        assert result is not None  # rolling() comes first
        calibration, ground = result.telemetry["CALIBRATION"], result.telemetry["GROUND"]
        robot = result.scenario.robot
        done = calibration["calibrated"] > 0
        calibrated_at = float(calibration["time"][np.argmax(done)]) if np.any(done) else float("nan")
        rows = (
            ("Coulomb part A, mN m", f"{1e3 * robot.coulomb:.3f}", f"{1e3 * calibration['coulomb'][-1]:.3f}"),
            ("viscous part B, mN m s/rad", f"{1e3 * robot.viscous:.3f}", f"{1e3 * calibration['viscous'][-1]:.3f}"),
        )
        chapter.tables.append(Table("Internal friction C_o = A + B omega", ("", "simulated robot", "calibrated"), rows))
        sand_at = float(result.time[np.argmax(result.truth["segment"] == 1)])
        use = (ground["valid"] > 0) & (ground["time"] > sand_at + 0.3)  # windows of 0.3 s that lie on the sand
        ticks = np.round(ground["time"][use] * 1000).astype(int)
        truth = result.truth["contact_torque"][ticks]
        worst = float(np.max(np.abs(ground["torque"][use] - truth)))
        last = {name: float(values[use][-1]) for name, values in ground.items()}
        names = {number: name for name, number in result.interface.enums["terrain"].items()}
        self.stage.tell(
            chapter,
            f"Calibrated {calibrated_at:.1f} s after the start; "
            "the floor's own resistance (0.010 ± 0.0005) is subtracted and its sd carried on.",
        )
        self.stage.tell(
            chapter,
            f"On the sand: C_t = {1e3 * last['torque']:.2f} ± {1e3 * last['torque_sd']:.2f} mN m (truth "
            f"{1e3 * truth[-1]:.2f}; greatest error of {len(truth)} valid values {1e3 * worst:.2f}), "
            f"f_r = {last['f_r']:.4f}. Nearest terrain of Table 1: {names[int(last['terrain'])]}, "
            f"{last['margin']:.1f} sd before the next.",
        )
        picture = figures.ground_torque(result, sand_at, calibrated_at, self.stage.out / "ground_torque.png")
        chapter.pictures.append((picture, "From hard floor to dry sand: axle speed, swing, and C_t against the truth"))

    def limiter(self, chapter: Chapter) -> None:
        """Slip is held at 0.5, and a slope too steep ends in a way back"""
        limited, free = self._run("carriage_limiter"), self._run("carriage_free")
        fall = limited.time >= limited.scenario.carriage[-2][0]
        slip, slip_free = limited.truth["slip"][fall], free.truth["slip"][fall]
        self.stage.tell(
            chapter,
            "A carriage slows the axle on sand from 0.36 to 0.04 m/s within 10 s, at 8 V. With the limiter slip peaks "
            f"at {np.max(slip):.3f} and stays between {np.min(slip[5000:]):.3f} and {np.max(slip[5000:]):.3f} from 5 s "
            f"on; without it, it reaches {np.max(slip_free):.3f}.",
        )
        picture = figures.slip_limiter(limited, free, self.stage.out / "slip_limiter.png")
        chapter.pictures.append((picture, "Slip on the carriage, with and without the limiter"))
        up, stuck = self._run("slope_limiter"), self._run("slope_free")
        names = {number: name for name, number in up.interface.enums["report"].items()}
        report = names[int(up.telemetry["REPORT"]["report"][-1])]
        ready = "ready again" if up.telemetry["STATUS"]["ready"][-1] else "not ready"
        way = up.truth["position"]
        crawl = 1e3 * float(np.max(np.abs(stuck.truth["speed"][-1000:])))
        self.stage.tell(
            chapter,
            "A free slope of 14 degrees, where this sand carries at most 11.3: with the limiter the shell comes to a "
            f"stop {np.max(way):.2f} m from its start, backs out to {way[-1]:.2f} m, reports '{report}' and is "
            f"{ready}. Without it slip reaches {np.max(stuck.truth['slip']):.3f} and the shell stays stuck: "
            f"{crawl:.1f} mm/s over the last second, its rut {stuck.truth['rut'][-1]:.2f} deep on a scale of 0 to 1.",
        )
        picture = figures.slope(up, stuck, self.stage.out / "slope.png")
        chapter.pictures.append((picture, "The slope, with and without the limiter"))
        chapter.commands += [
            f"terrapin run {name}" for name in ("carriage_limiter", "carriage_free", "slope_limiter", "slope_free")
        ]

    def log(self, chapter: Chapter) -> None:
        """The telemetry, as a candump log, read through the generated DBC"""
        log = self.stage.out / "runs" / "floor_to_sand" / "telemetry.log"
        shutil.copy(paths.dbc(), self.stage.out / "terrapin.dbc")
        database: Any = cantools.database.load_file(self.stage.out / "terrapin.dbc")
        lines = log.read_text(encoding="ascii").splitlines()
        last = dict(line.split()[2].split("#") for line in lines)  # identifier -> data
        rows = []
        for message in map(database.get_message_by_name, ("ACTUATE", "GROUND", "MOTION", "ELECTRICAL")):
            values = message.decode_simple(bytes.fromhex(last[f"{message.frame_id:03X}"]))
            said = (f"{k} = {v:.6g}" if isinstance(v, float) else f"{k} = {v}" for k, v in values.items())
            rows.append((message.name, ", ".join(said)))
        self.stage.tell(chapter, f"{len(lines)} frames; the last of each message, decoded by cantools:")
        for name, text in rows:
            self.stage.say(f"  {name}: {text}")
        chapter.tables.append(Table("Decoded with cantools", ("message", "signals"), tuple(rows)))
        chapter.links += [(log, "telemetry.log"), (self.stage.out / "terrapin.dbc", "terrapin.dbc")]
        chapter.commands.append("cantools decode out/terrapin.dbc < out/runs/floor_to_sand/telemetry.log")

    def forced_slip(self, chapter: Chapter) -> None:
        """A model against real measurements: the forced-slip table of Li and others"""
        workbench.forced_slip(self.stage, chapter)

    def heated(self, chapter: Chapter) -> None:
        """A winding heats by 40 K: found in the data, added to the model, sent to the controller"""
        workbench.heated(self.stage, chapter)
