"""The variables of an exported FMU, and the model description that lists them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal
from xml.sax.saxutils import quoteattr

from terrapin_hil.messages import Interface, Message
from terrapin_hil.robot.truth import TRUTH, UNITS

__all__ = ["BASES", "Kind", "Model", "Variable", "model_description", "model_variables", "spoken"]

Kind = Literal["controller", "plant", "both"]
Type = Literal["float64", "int32", "int64", "uint64", "boolean"]
BASES: dict[Type, int] = {"float64": 0, "int32": 10000, "int64": 20000, "uint64": 30000, "boolean": 40000}  # fmu.h
ELEMENTS = {"float64": "Float64", "int32": "Int32", "int64": "Int64", "uint64": "UInt64", "boolean": "Boolean"}
NAMES = {"controller": "TerrapinController", "plant": "TerrapinPlant", "both": "TerrapinRobot"}
ORDER = ("time", "parameter", "input", "output")

# What goes from the robot's sensors and operator to the controller, as terrapin_inputs has it: (low, high, what).
CODE, COUNT, SIGNED = (0, 4095), (0, 65535), (-32768, 32767)
WIRE: dict[str, tuple[int, int, str]] = {
    "tick": (-1, 2**31 - 1, "ms since reset; -1: the FMU counts them itself"),
    "current_code": (*CODE, "12-bit converter, motor current"),
    "supply_code": (*CODE, "12-bit converter, supply of the bridge"),
    "temperature_code": (*CODE, "12-bit converter, temperature of the winding"),
    "motor_count": (*COUNT, "encoder of the drive wheel, wraps"),
    "ground_count": (*COUNT, "encoder of the trailing wheel, wraps"),
    "swing_angle_mrad": (*SIGNED, "swing of the inner body [mrad]"),
    "swing_rate_centirad_s": (*SIGNED, "its rate [0.01 rad/s]"),
    "pitch_mrad": (*SIGNED, "slope of the ground [mrad], uphill positive"),
    "ground_speed_mm_s": (*SIGNED, "speed of the axle from outside [mm/s]"),
    "heading_turn": (*COUNT, "steering of the inner body, one turn = 65536"),
    "request": (0, 255, "of the operator: 0 idle, 1 calibrate, 2 run, 3 clear"),
    "control": (0, 255, "0 voltage, 1 speed of the rim"),
    "setpoint": (*SIGNED, "of the operator [mV or mm/s]"),
}
FLAGS = {
    "swing_valid": "swing_angle_mrad and swing_rate_centirad_s are measured",
    "pitch_valid": "pitch_mrad is measured",
    "ground_speed_valid": "ground_speed_mm_s is measured",
    "heading_valid": "heading_turn is measured",
    "estop": "the emergency stop is pressed, or its wire broken",
    "command_fresh": "a COMMAND arrived: in the first tick of the step",
    "limiter": "slip limiter on, as the operator asks",
    "silent": "no frame arrives: the controller makes no step",
}


@dataclass(frozen=True)
class Variable:
    """One variable; `place` among those of its type. `enum` names one of the interface's."""

    name: str
    type: Type
    causality: Literal["time", "parameter", "input", "output"]
    place: int
    start: float = 0
    low: float | None = None
    high: float | None = None
    unit: str = ""
    enum: str = ""
    what: str = ""

    @property
    def reference(self) -> int:
        """FMI's value reference."""
        return BASES[self.type] + self.place


@dataclass
class Model:
    """What is exported; variables in the order of their value references for each type."""

    kind: Kind
    variables: list[Variable] = field(default_factory=list)

    @property
    def name(self) -> str:
        """FMI's model identifier."""
        return NAMES[self.kind]

    def add(
        self, name: str, type_: Type, causality: Literal["time", "parameter", "input", "output"], **more: object
    ) -> None:
        """One more, behind all of its type that can be set before it."""
        place = sum(each.type == type_ for each in self.variables)
        assert all(ORDER.index(v.causality) <= ORDER.index(causality) for v in self.variables if v.type == type_)
        self.variables.append(Variable(name, type_, causality, place, **more))  # type: ignore[arg-type]

    def of(self, type_: Type, *causalities: str) -> list[Variable]:
        """Those of a type, and of some causalities."""
        return [v for v in self.variables if v.type == type_ and (not causalities or v.causality in causalities)]

    def named(self, name: str) -> Variable:
        """KeyError when there is none."""
        return next(v for v in self.variables if v.name == name)


def spoken(interface: Interface) -> list[Message]:
    """The frames that a step of the controller sends."""
    return [m for m in interface.messages.values() if m.sender == "controller" and m.cycle_ms in (1, 10)]


def model_variables(kind: Kind, interface: Interface, values: Mapping[str, float], seed: int) -> Model:
    """All variables of a model; `values` of the controller's parameters over their defaults, in their units."""
    model = Model(kind)
    controller, plant = kind != "plant", kind != "controller"
    model.add("time", "float64", "time", unit="s")
    if controller:
        for p in interface.parameters.values():
            start = p.raw(values[p.name]) * p.scale if p.name in values else p.default * p.scale
            low, high = p.minimum * p.scale, p.maximum * p.scale
            model.add(
                p.name, "float64", "parameter", start=start, low=low, high=high, unit=p.unit or "1", what=p.meaning
            )
    if plant:
        model.add("seed", "uint64", "parameter", start=seed, what="of the noise of the sensors")
    if kind != "both":
        if kind == "plant":
            model.add(
                "duty_q15", "int32", "input", low=-32768, high=32767, what="of the bridge: duty / 32768 of the supply"
            )
            model.add("enable", "boolean", "input", what="of the bridge")
        way: Literal["input", "output"] = "output" if plant else "input"
        for name, (low_, high_, what) in WIRE.items():
            start = -1 if name == "tick" and way == "input" else 0
            model.add(name, "int32", way, start=start, low=low_, high=high_, what=what)
        for name, what in FLAGS.items():
            model.add(name, "boolean", way, what=what)
    if plant:
        for name in TRUTH:
            model.add("truth_time" if name == "time" else name, "float64", "output", unit=UNITS[name])
        model.add("beta", "float64", "output", unit="rad", what="angle of the shell")
        model.add("alpha", "float64", "output", unit="rad", what="angle of the drive against the inner body")
    if controller:
        model.add(
            "duty_q15", "int32", "output", low=-32768, high=32767, what="of the bridge: duty / 32768 of the supply"
        )
        model.add("enable", "boolean", "output", what="of the bridge")
        model.add("faults", "uint64", "output", what="one bit a fault")
        model.add("frame_count", "int32", "output", what="frames of the step's last tick")
        for what, name, type_ in (("identifier, -1: none", "id", "int32"), ("bytes", "length", "int32"),
                                  ("first byte lowest", "data", "uint64")):  # fmt: skip
            for i in (1, 2):
                model.add(f"frame_{i}.{name}", type_, "output", what=what, start=-1 if name == "id" else 0)  # type: ignore[arg-type]
        for message in spoken(interface):
            for signal in message.signals:
                name = f"{message.name}.{signal.name}"
                if signal.enum:
                    model.add(name, "int64", "output", enum=signal.enum, what=signal.comment)
                elif signal.length == 1:
                    model.add(name, "boolean", "output", what=signal.comment)
                else:
                    model.add(name, "float64", "output", unit=signal.unit or "1", what=signal.comment)
    return model


def _attributes(**given: object) -> str:
    return "".join(f" {name}={quoteattr(str(value))}" for name, value in given.items() if value not in (None, ""))


def _number(variable: Variable, value: float) -> str:
    if variable.type == "boolean":
        return "true" if value else "false"
    return repr(float(value)) if variable.type == "float64" else str(int(value))


def _element(v: Variable) -> str:
    if v.causality == "time":
        return '    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>'
    shown = {"name": v.name, "valueReference": v.reference, "causality": v.causality}
    shown["variability"] = "fixed" if v.causality == "parameter" else "discrete"
    if v.causality == "output":
        shown["initial"] = "calculated"
    else:
        shown["start"] = _number(v, v.start)
    if v.enum:
        return f"    <Enumeration{_attributes(**shown, declaredType=v.enum, description=v.what)}/>"
    low = None if v.low is None else _number(v, v.low)
    high = None if v.high is None else _number(v, v.high)
    unit = v.unit if v.type == "float64" else ""
    return f"    <{ELEMENTS[v.type]}{_attributes(**shown, min=low, max=high, unit=unit, description=v.what)}/>"


def _types(model: Model, interface: Interface) -> Iterable[str]:
    for name in dict.fromkeys(v.enum for v in model.variables if v.enum):
        yield f"    <EnumerationType{_attributes(name=name)}>"
        for word, number in interface.enums[name].items():
            yield f"      <Item{_attributes(name=word, value=number)}/>"
        yield "    </EnumerationType>"


def model_description(model: Model, interface: Interface, token: str, about: str, seconds: float) -> str:
    """modelDescription.xml."""
    units = sorted({v.unit for v in model.variables if v.unit and v.type == "float64"})
    types = list(_types(model, interface))
    outputs = [v for v in model.variables if v.causality == "output"]
    what = _attributes(
        fmiVersion="3.0", modelName=model.name, instantiationToken=token, description=about, license="Apache-2.0",
        generationTool="Terrapin", variableNamingConvention="structured",
    )  # fmt: skip
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<fmiModelDescription{what}>",
        f'  <CoSimulation modelIdentifier="{model.name}" canHandleVariableCommunicationStepSize="true"'
        ' fixedInternalStepSize="0.001" canGetAndSetFMUState="true" canSerializeFMUState="true"/>',
        "  <UnitDefinitions>",
        *(f"    <Unit{_attributes(name=unit)}/>" for unit in units),
        "  </UnitDefinitions>",
        *(["  <TypeDefinitions>", *types, "  </TypeDefinitions>"] if types else []),
        f'  <DefaultExperiment startTime="0" stopTime="{seconds:g}" stepSize="0.001"/>',
        "  <ModelVariables>",
        *(_element(v) for v in model.variables),
        "  </ModelVariables>",
        "  <ModelStructure>",
        *(f'    <Output valueReference="{v.reference}"/>' for v in outputs),
        *(f'    <InitialUnknown valueReference="{v.reference}"/>' for v in outputs),
        "  </ModelStructure>",
        "</fmiModelDescription>",
        "",
    ]
    return "\n".join(lines)
