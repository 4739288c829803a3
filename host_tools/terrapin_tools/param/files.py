"""Values of parameters as text and as TOML files: the table [parameters] that `terrapin run --parameters` reads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from terrapin_hil.messages import Interface, Parameter
from terrapin_hil.reading import load
from terrapin_tools.errors import UserError

__all__ = ["raw_of", "read_file", "read_parameters", "require_own", "text_of", "to_toml"]


def text_of(parameter: Parameter, raw: int) -> str:
    """A raw value in the parameter's unit, with the digits that its scale needs."""
    return f"{raw * parameter.scale:.12g}"


def raw_of(parameter: Parameter, text: str, is_raw: bool = False) -> int:
    """The raw value of what a user wrote: a number in the parameter's unit, a quantity, or a raw integer.

    UserError for what does not convert or is out of range, which is named.
    """
    try:
        if is_raw:
            try:
                raw = int(text, 0)
            except ValueError:
                raise ValueError(f"found {text!r}, expected an integer") from None
            if not parameter.minimum <= raw <= parameter.maximum:
                raise ValueError(f"raw {raw} is outside {parameter.minimum} to {parameter.maximum}")
            return raw
        try:
            number: float | str = float(text)
        except ValueError:
            number = text
        return parameter.raw(parameter.number(number))
    except ValueError as error:
        raise UserError(
            f"parameter {parameter.name}: {str(error).removeprefix(f'parameter {parameter.name}: ')}"
        ) from None


def read_parameters(path: Path, description: Interface) -> dict[str, float]:
    """The table [parameters] of a TOML file, in the units of controller.toml. ReadingError names what is wrong."""
    from terrapin_hil.scenario.scenario import parameters_of  # brings SciPy along, which takes most of a second

    root = load(path)
    if "parameters" not in root:
        raise root.error(None, "found no table [parameters], expected one with a line for each parameter")
    return parameters_of(root.section("parameters"), description)


def require_own(path: Path) -> None:
    """UserError when a TOML file says that it is of a run of another robot than that of this process, whose
    parameters have other ranges and whose frames other steps."""
    from terrapin_hil.robots import selected

    root = load(path)
    said = root.section("run").text("robot", "") if "run" in root else ""
    if said not in ("", selected().name):
        raise UserError(f"{path}: run.robot: found {said!r}, expected {selected().name!r}: name it with --robot")


def read_file(path: Path, description: Interface) -> dict[str, int]:
    """Parameter -> raw value, of the table [parameters] in a TOML file. UserError names file, line and field."""
    values = read_parameters(path, description)
    return {name: description.parameter(name).raw(value) for name, value in values.items()}


def to_toml(description: Interface, values: Mapping[str, int], origin: str) -> str:
    """Raw `values` as such a file; `origin` says in its first line where they come from."""
    lines = [f"# Parameters of the controller, {origin}.", "", "[parameters]"]
    for name, raw in values.items():
        parameter = description.parameter(name)
        unit = "" if parameter.unit == "1" else f"{parameter.unit}; "
        lines.append(f"{name} = {text_of(parameter, raw)}  # {unit}{parameter.meaning}")
    return "\n".join(lines) + "\n"
