"""The rolling robots and the car as models over time: sampled inputs in, motion and channels out, effects switched on.

    run = simulate("cmr", {"f_o": 0.092}, {"time": t, "voltage": v}, {"slope": {"gain": 1.0}})
    run.channels["omega"]

The equations stand in rolling.h (cmr), pendulum.h (pendulum_sphere) and vehicle.h (vehicle). Effects act as their
files say: changes of parameters and resisting torques inside the integrator (in formulas there, sign(x) is
tanh(x / smoothing)), then what is added to a channel, what it is multiplied by, and what measuring it adds or delays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from hil.physics.compiled import ffi, library, pointer
from hil.physics.effects import Effect, catalogue
from hil.physics.expression import parse
from hil.physics.program import ADD, FIRST, MULTIPLY, ROLES, TORQUE, Additions
from hil.physics.signals import delayed, derivative, integral, play
from hil.physics.tyre import ContactError

__all__ = ["MODELS", "DynamicModel", "Plan", "Run", "simulate"]

Array = npt.NDArray[np.float64]
MOST_VALUES = 160  # HIL_DYNAMIC_VALUES
CAR_STEP = 2.5e-3  # longest step of the car [s]


@dataclass(frozen=True)
class DynamicModel:
    """A base model. `parameters` are in the order of its C structs: name -> unit and default (None: must be given)."""

    name: str
    parameters: Mapping[str, tuple[str, float | None]]
    inputs: tuple[str, ...]  # roles that drive it
    channels: Mapping[str, str]  # name -> unit
    longest_step: float = 2e-3  # [s]: 1e-5 of the rates at start-up, where friction turns on
    aliases: Mapping[str, str] = field(default_factory=dict)  # further names of parameters in formulas
    encoder: tuple[str, ...] = ()  # channels that an encoder gives
    states = ("omega", "angle", "acceleration", "slip", "speed", "load")  # roles that it computes itself

    def slots(self) -> dict[str, int]:
        """Slots of everything that formulas may name, but for the effects' own."""
        found = {**ROLES, **{name: FIRST + i for i, name in enumerate(self.parameters)}}
        return {**found, **{alias: found[name] for alias, name in self.aliases.items()}}


_SMOOTHING: tuple[str, float | None] = ("rad/s", 0.05)

MODELS: Mapping[str, DynamicModel] = {
    model.name: model
    for model in (
        DynamicModel(
            "cmr",
            {
                "radius": ("m", 0.080),
                "drive_radius": ("m", 0.018),
                "arm": ("m", 0.062),
                "shell_mass": ("kg", 0.3),
                "body_mass": ("kg", 0.5),
                "drive_mass": ("kg", 1.1),
                "shell_inertia": ("kg m^2", 1.92e-3),
                "body_inertia": ("kg m^2", 2.0e-4),
                "drive_inertia": ("kg m^2", 1.8e-4),
                "gravity": ("m/s^2", 9.81),
                "torque_constant": ("N m/A", 0.10),
                "armature_resistance": ("ohm", 5.0),
                "resistance_slope": ("1/K", 0.0),
                "coulomb": ("N m", 0.012),
                "viscous": ("N m s/rad", 1.0e-3),
                "f_o": ("1", None),
                "smoothing": _SMOOTHING,
            },
            ("voltage",),
            {"omega": "rad/s", "current": "A", "swing_angle": "rad"},
            encoder=("omega",),
        ),
        DynamicModel(
            "pendulum_sphere",
            {
                "radius": ("m", 0.220),
                "shell_mass": ("kg", 4.29),
                "frame_mass": ("kg", 2.0),
                "bob_mass": ("kg", 1.5),
                "length": ("m", 0.130),
                "shell_inertia": ("kg m^2", 2.0 / 3.0 * 4.29 * 0.22**2),
                "frame_inertia": ("kg m^2", 0.012),
                "bob_inertia": ("kg m^2", 0.001),
                "gravity": ("m/s^2", 9.81),
                "viscous": ("N m s/rad", 0.7),
                "shell_share": ("1", 1.0),
                "f_o": ("1", None),
                "rolling_slip": ("1", 0.0),
                "incline": ("rad", 0.0),
                "smoothing": _SMOOTHING,
            },
            ("joint_rate",),
            {"torque": "N m", "rolling_angle": "rad", "swing_angle": "rad"},
            encoder=("rolling_angle",),
        ),
        DynamicModel(
            "vehicle",
            {
                "mass": ("kg", 1797.0),
                "gravity": ("m/s^2", 9.81),
                "drag": ("N s^2/m^2", 0.55),
                "front_distance": ("m", 1.10),
                "rear_distance": ("m", 1.47),
                "height": ("m", 0.65),
                "wheel_inertia": ("kg m^2", 1.2),
                "relaxation_length": ("m", 0.30),
                "speed_floor": ("m/s", 0.3),
                "load_floor": ("N", 300.0),
                "tyre_radius": ("m", 0.35565),
                "tyre_width": ("m", 0.235),
                "tyre_stiffness": ("N/m", 180e3),
                "tyre_angle_share": ("1", 0.30),
                "tyre_angle_slip": ("1", 0.10),
                "k_s": ("Pa/m^n", None),
                "n": ("1", None),
                "cohesion": ("Pa", None),
                "friction_angle": ("rad", None),
                "shear_modulus": ("m", None),
            },
            ("drive_torque",),
            {**{f"omega_{wheel}": "rad/s" for wheel in ("fl", "fr", "rl", "rr")}, "speed": "m/s"},
            CAR_STEP,
            {"radius": "tyre_radius"},
            tuple(f"omega_{wheel}" for wheel in ("fl", "fr", "rl", "rr")),
        ),
    )
}


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

    def __init__(self, model: DynamicModel, effects: Sequence[Effect], names: Sequence[str] = ()) -> None:
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
        self.template[self.slots["temperature"]] = 25.0
        for effect in self.effects:
            for name, value in effect.options.items():
                self.template[self.own[effect.name][name]] = value
        self.additions = Additions(self.slots, 0.05)
        self.outside: list[Effect] = []  # act on channels, in order of their stages
        for effect in self.effects:
            slots = self.own[effect.name]
            ground = effect.where == "ground"
            target = effect.on.get(model.name, effect.target)
            if effect.transform or target in model.channels:
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
        """Simulate over `time` [s], rising, from rest or from steady motion at `start` [rad/s] (of the drive or wheel).

        `inputs` are arrays over time by name (what drives the model must be among them), the first `angle` [rad] if
        given is where the rotation starts. Not finite where the model has no value: a wheel load that no soil carries.
        """
        table = values.copy()
        gear = "drive_radius"
        table[self.slots["gear"]] = table[self.slots["radius"]] / table[self.slots[gear]] if gear in self.slots else 1.0
        columns = {name: column for name, column in inputs.items() if name in self.slots and name != "time"}
        if self.model.name == "vehicle":
            motion, channels = self._car(table, time, columns, start)
        else:
            motion, channels = self._body(table, time, columns, start)
        return Run(time, self._measured(table, time, columns, motion, channels), motion)

    def _columns(self, columns: Mapping[str, Array]) -> tuple[Array, list[int]]:
        taken = {n: c for n, c in columns.items() if n not in self.model.states}
        slots = [self.slots[name] for name in taken]
        rows = len(next(iter(columns.values()))) if columns else 0
        return np.ascontiguousarray(np.column_stack(list(taken.values())) if taken else np.zeros((rows, 0))), slots

    def _body(
        self, table: Array, time: Array, columns: Mapping[str, Array], start: float
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        f, lib = ffi(), library()
        driven = self.model.name == "pendulum_sphere"
        base = lib.HIL_DYNAMIC_PENDULUM if driven else lib.HIL_DYNAMIC_CMR
        stacked, slots = self._columns(columns)
        clock = np.ascontiguousarray(time, dtype=np.float64)
        numbers = f.new("int[]", slots or [0])
        drive = f.new("hil_drive_record *", (len(clock), pointer(clock), len(slots), numbers, pointer(stacked)))
        angle = float(columns["angle"][0]) if "angle" in columns else 0.0
        state = np.array([angle, angle, start, start])
        common = (base, self._native, drive, len(table), pointer(table), pointer(state))
        if start != 0.0:
            state[0] += lib.hil_dynamic_steady_swing(*common)
        record = np.empty((len(clock), lib.HIL_DYNAMIC_RECORD))
        lib.hil_dynamic_run(*common, self.model.longest_step, pointer(record))
        radius = table[self.slots["radius"]]
        slip = table[self.slots["rolling_slip"]] if driven else 0.0
        names = ("shell_mass", "frame_mass", "bob_mass") if driven else ("shell_mass", "body_mass", "drive_mass")
        weight = sum(table[self.slots[name]] for name in names) * table[self.slots["gravity"]]
        swing = record[:, 0] - record[:, 1]
        motion = {
            "omega": record[:, 2],
            "angle": record[:, 0],
            "acceleration": record[:, 4],
            "shell_rate": record[:, 3],
            "shell_angle": record[:, 1],
            "swing_angle": swing,
            "swing_rate": record[:, 2] - record[:, 3],
            "speed": radius * record[:, 3] * (1.0 - slip),
            "slip": np.full(len(clock), slip),
            "load": np.full(len(clock), weight),
        }
        if driven:
            return motion, {"torque": record[:, 6], "rolling_angle": record[:, 1], "swing_angle": swing}
        return motion, {"omega": record[:, 2], "current": record[:, 6], "swing_angle": swing}

    def _car(
        self, table: Array, time: Array, columns: Mapping[str, Array], start: float
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        f, lib = ffi(), library()
        period = float(time[-1] - time[0]) / max(len(time) - 1, 1)  # the samples are evenly spaced
        substeps = max(1, int(np.ceil(period / self.model.longest_step - 1e-9)))
        torque = np.ascontiguousarray(columns["drive_torque"], dtype=np.float64)
        stacked, slots = self._columns({n: c for n, c in columns.items() if n != "drive_torque"})
        numbers = f.new("int[]", slots or [0])
        record = np.full((len(time), 9), np.nan)
        effects = f.NULL
        if self.additions.terms:
            effects = f.new(
                "hil_vehicle_effects *",
                (self._native, len(table), pointer(table), len(slots), numbers, pointer(stacked)),
            )
        place = [pointer(table) + FIRST + skip for skip in (0, 10, 15)]
        failure = f.new("hil_vehicle_failure *")
        status = lib.hil_vehicle_run(
            f.cast("hil_vehicle *", place[0]),
            f.cast("hil_tyre *", place[1]),
            f.cast("hil_tyre_soil *", place[2]),
            len(time),
            period,
            substeps,
            pointer(torque),
            start,
            effects,
            pointer(record),
            f.NULL,
            failure,
        )
        if status != lib.HIL_TYRE_OK:
            record[:] = np.nan
        omega = {"omega_fl": 1, "omega_fr": 1, "omega_rl": 2, "omega_rr": 2}
        channels = {name: record[:, column] for name, column in omega.items()} | {"speed": record[:, 0]}
        rear = record[:, 2]
        weight = table[self.slots["mass"]] * table[self.slots["gravity"]]
        motion = {
            "omega": rear,
            "angle": integral(time, rear),
            "acceleration": derivative(time, rear),
            "speed": record[:, 0],
            "omega_front": record[:, 1],
            "load": np.full(len(time), weight),
            "slip": 1.0 - record[:, 0] / np.maximum(rear * table[self.slots["tyre_radius"]], 0.3),
            "sinkage": record[:, 7],
        }
        return motion, channels

    def _measured(
        self,
        table: Array,
        time: Array,
        columns: Mapping[str, Array],
        motion: Mapping[str, Array],
        channels: dict[str, Array],
    ) -> dict[str, Array]:
        """Channels after what acts on them: additions, gains, what measuring adds, delays and play."""
        if not self.outside:
            return channels
        known: dict[str, Array | float] = {name: table[slot] for name, slot in self.slots.items()}
        known.update(columns)
        known.update(motion)
        known["time"] = time
        for stage in ("channel", "gain", "measured", "transform"):
            for effect in self.outside:
                if stage != ("transform" if effect.transform else effect.stage):
                    continue
                own = {name: table[slot] for name, slot in self.own[effect.name].items()}
                target = effect.on.get(self.model.name, effect.target)
                several = {"measured": tuple(channels), "encoder": self.model.encoder}
                for name in several.get(target, (target,)):
                    here = {**known, **own}
                    if name.startswith("omega_"):  # of this wheel
                        here["omega"], here["angle"] = channels[name], integral(time, channels[name])
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
    model = MODELS[base]
    chosen = {name: catalogue()[name] for name in effects or {}}
    arrays = {name: np.asarray(column, dtype=np.float64) for name, column in inputs.items()}
    for name in ("time", *model.inputs):
        if name not in arrays:
            raise ContactError(f"{base}: input {name} is missing, expected an array over time")
    for name, effect in chosen.items():
        if base not in effect.bases:
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
