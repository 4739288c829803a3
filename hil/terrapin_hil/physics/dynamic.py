"""The rolling robots and the car as models over time: sampled inputs in, motion and channels out, effects switched on.

    run = simulate("cmr", {"f_o": 0.092}, {"time": t, "voltage": v}, {"slope": {"gain": 1.0}})
    run.channels["omega"]

What is integrated, and how, stands in physics/bodies, one file a body. Effects act as their files say: changes of
parameters and resisting torques inside the integrator (in formulas there, sign(x) is tanh(x / smoothing)), then what is
added to a channel, what it is multiplied by, and what measuring it adds or delays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from terrapin_hil.arrays import Array
from terrapin_hil.messages import interface
from terrapin_hil.physics.bodies import Body, Drive, bodies, wheel_slip
from terrapin_hil.physics.effects import Effect, catalogue
from terrapin_hil.physics.expression import parse
from terrapin_hil.physics.program import ADD, FIRST, MULTIPLY, TORQUE, Additions
from terrapin_hil.physics.signals import delayed, derivative, integral, play
from terrapin_hil.physics.tyre import ContactError

__all__ = ["Plan", "Run", "simulate"]

MOST_VALUES = 160  # HIL_DYNAMIC_VALUES
NEIGHBOURS = 48  # that are integrated together; HIL_DYNAMIC_COLUMNS at most


@dataclass(frozen=True)
class Run:
    """One simulated run: channels as measured, and the motion, by name; arrays over the samples."""

    time: Array
    channels: Mapping[str, Array]
    motion: Mapping[str, Array]


class Plan:
    """A base model with effects, ready to run with any values: `slots` says where each stands in the table.

    `names` are further names that formulas use (constants, columns of the data); parameters of an effect stand at
    `own[effect][parameter]`. Cheap to run, not to make.
    """

    def __init__(self, model: Body, effects: Sequence[Effect], names: Sequence[str] = ()) -> None:
        self.model, self.effects = model, tuple(effects)
        self.slots = model.slots()
        count = FIRST + len(model.parameters)
        for name in names:
            if name not in self.slots:
                self.slots[name] = count
                count += 1
        self.slots["gear"] = count  # turns of the drive's encoder for one of the shell or wheel
        count += 1
        self.own: dict[str, dict[str, int]] = {}
        for effect in self.effects:
            mine = [*(p.name for p in effect.parameters), *effect.options]
            self.own[effect.name] = {name: count + i for i, name in enumerate(mine)}
            count += len(mine)
        if count > MOST_VALUES:
            raise ValueError(f"found {count} values, expected at most {MOST_VALUES}: fewer columns or effects")
        self.template = np.zeros(count)
        for name, (_, default) in model.parameters.items():
            self.template[self.slots[name]] = np.nan if default is None else default
        self.template[self.slots["pass_"]] = 1.0
        self.template[self.slots["temperature"]] = interface().constants["reference_temperature"]
        for effect in self.effects:
            for name, value in effect.options.items():
                self.template[self.own[effect.name][name]] = value
        self.additions = Additions(self.slots, 0.05)
        self.outside: list[Effect] = []  # act on channels, in order of their stages
        for effect in self.effects:
            slots = self.own[effect.name]
            ground = effect.where == "ground"
            target = model.target(effect)
            if effect.transform or target in (*model.channels, "encoder", "measured"):
                self.outside.append(effect)
            elif target in ("resistance", "rolling_resistance"):
                self.additions.add(effect.expression, TORQUE, ground or target != "resistance", slots=slots)
            else:
                kind = ADD if effect.additive else MULTIPLY
                self.additions.add(effect.expression, kind, ground, target, slots)
        self._native, self._kept = self.additions.native()

    def values(self) -> Array:
        """A table of values to fill: the defaults of the parameters, NaN where there is none."""
        return self.template.copy()

    def run(self, values: Array, time: Array, inputs: Mapping[str, Array], start: float = 0.0) -> Run:
        """Motion and channels over time, from rest or from steady motion.

        Values are not finite where no soil carries a wheel's load, and from where a motion leaves all bounds.

        Parameters
        ----------
        values : table of slots, from `values` or filled by the caller.
        time : (samples,), s, rising.
        inputs : by name (samples,); what drives the model is among them. Rotation starts at the first `angle` [rad].
        start : rad/s of the drive or wheel at the first sample.
        """
        drive = self._drive(values[None], time, inputs, start)
        record, _ = self.model.follow(drive)
        return Run(
            time, self._measured(drive, drive.tables[0], record), self.model.motion(drive, drive.tables[0], record)
        )

    def channels(
        self, values: Array, time: Array, inputs: Mapping[str, Array], start: float = 0.0
    ) -> Mapping[str, Array]:
        """Those of `run`."""
        drive = self._drive(values[None], time, inputs, start)
        return self._measured(drive, drive.tables[0], self.model.follow(drive)[0])

    def near(
        self, tables: Array, time: Array, inputs: Mapping[str, Array], start: float = 0.0
    ) -> list[Mapping[str, Array]]:
        """Channels of a run and of its neighbours, to first order in what these change of the motion.

        `tables` (1 + neighbours, slots): tables of values, that of the run first; the rest as for `run`. All are
        integrated together, so a neighbour costs a fraction of a run.
        """
        found: list[Mapping[str, Array]] = []
        for begin in range(1, max(len(tables), 2), NEIGHBOURS):
            drive = self._drive(np.vstack([tables[:1], tables[begin : begin + NEIGHBOURS]]), time, inputs, start)
            record, change = self.model.follow(drive)
            records = [record, *(record + one for one in change)]
            found += [self._measured(drive, table, one) for table, one in zip(drive.tables, records, strict=True)]
            if begin > 1:
                del found[begin]  # the run itself once more
        return found

    def shaped(
        self, tables: Array, time: Array, inputs: Mapping[str, Array], start: float, shapes: Array
    ) -> list[Mapping[str, Array]]:
        """What a neighbour of a run changes in its channels, to first order, when it differs by each of `shapes`
        (samples, count), linear between samples, times what its table says. `tables` (2, slots), the run's and the
        neighbour's, the rest as for `run`; many shapes cost little more than one."""
        found: list[Mapping[str, Array]] = []
        for begin in range(0, shapes.shape[1], NEIGHBOURS):
            some = np.ascontiguousarray(shapes[:, begin : begin + NEIGHBOURS])
            drive = self._drive(tables, time, inputs, start, some)
            record, change = self.model.follow(drive)
            here = self._measured(drive, drive.tables[0], record)
            for one in change:
                there = self._measured(drive, drive.tables[1], record + one)
                found.append({name: there[name] - here[name] for name in here})
        return found

    def _drive(
        self, values: Array, time: Array, inputs: Mapping[str, Array], start: float, shapes: Array | None = None
    ) -> Drive:
        tables = np.array(values)
        gear, radius = "drive_radius", self.slots["radius"]
        tables[:, self.slots["gear"]] = tables[:, radius] / tables[:, self.slots[gear]] if gear in self.slots else 1.0
        columns = {name: column for name, column in inputs.items() if name in self.slots and name != "time"}
        return Drive(self.model, self.slots, tables, time, columns, start, self._native, shapes)

    def _measured(self, drive: Drive, table: Array, record: Array) -> dict[str, Array]:
        """Channels after what acts on them: additions, gains, what measuring adds, delays and play."""
        channels = self.model.read(drive, table, record)
        if not self.outside:
            return channels
        time = drive.time
        known: dict[str, Array | float] = {name: table[slot] for name, slot in self.slots.items()}
        known.update(drive.columns)
        known.update(self.model.motion(drive, table, record))
        known["time"] = time
        for stage in ("channel", "gain", "measured", "transform"):
            for effect in self.outside:
                if stage != ("transform" if effect.transform else effect.stage):
                    continue
                own = {name: table[slot] for name, slot in self.own[effect.name].items()}
                target = self.model.target(effect)
                several = {"measured": tuple(channels), "encoder": self.model.encoder}
                for name in several.get(target, (target,)):
                    here = {**known, **own}
                    if name.startswith("omega_"):  # of this wheel
                        here["omega"], here["angle"] = channels[name], integral(time, channels[name])
                        here["slip"] = wheel_slip(known["speed"], channels[name], known["radius"])
                        here["side"] = 1.0 if name.endswith("l") else -1.0
                    change = parse(effect.expression).evaluate(here)
                    rate = self.model.channels[name] == "rad/s"
                    if effect.transform == "delay":
                        channels[name] = delayed(time, channels[name], float(change))
                    elif effect.transform == "play":
                        channels[name] = play(time, channels[name], float(change), rate)
                    elif effect.transform == "angle":
                        channels[name] = channels[name] + (derivative(time, change) if rate else change)
                    elif stage == "gain":
                        channels[name] = channels[name] * (1.0 + change)
                    else:
                        channels[name] = channels[name] + change
        return channels


def simulate(
    base: str,
    parameters: Mapping[str, float],
    inputs: Mapping[str, npt.ArrayLike],
    effects: Mapping[str, Mapping[str, float]] | None = None,
    start: float = 0.0,
) -> Run:
    """One run of a base model with effects of the catalogue at the given values of their parameters.

    `parameters` overrides the defaults and gives constants of effects; `inputs` holds `time` [s], what drives the model
    and any further role. ContactError names what is missing.

    >>> t = np.arange(0.0, 6.0, 0.01)
    >>> sand = simulate("cmr", {"f_o": 0.092}, {"time": t, "voltage": np.full(t.size, 5.0)},
    ...                 {"speed_squared": {"f_s": 0.28e-3}})
    >>> f"{sand.channels['omega'][-1]:.4f} rad/s, {sand.channels['current'][-1]:.4f} A"
    '6.8111 rad/s, 0.3946 A'
    """
    model = bodies()[base]
    chosen = {name: catalogue()[name] for name in effects or {}}
    arrays = {name: np.asarray(column, dtype=np.float64) for name, column in inputs.items()}
    for name in ("time", *model.inputs):
        if name not in arrays:
            raise ContactError(f"{base}: input {name} is missing, expected an array over time")
    for name, effect in chosen.items():
        if not model.takes(effect):
            raise ContactError(f"{name}: acts on {' or '.join(effect.bases)}, found base {base}")
    plan = Plan(model, list(chosen.values()), [*parameters, *arrays])
    values = plan.values()
    for name, value in parameters.items():
        values[plan.slots[name]] = value
    for name, own in (effects or {}).items():
        for parameter in chosen[name].parameters:
            values[plan.own[name][parameter.name]] = own.get(parameter.name, parameter.start)
        for option in chosen[name].options:
            values[plan.own[name][option]] = own.get(option, chosen[name].options[option])
    for name in model.parameters:
        if np.isnan(values[plan.slots[name]]):
            raise ContactError(f"{base}: parameter {name} is missing, expected a number")
    return plan.run(values, arrays["time"], {n: a for n, a in arrays.items() if n != "time"}, start)
