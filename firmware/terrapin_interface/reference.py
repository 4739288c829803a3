"""The description as pages: interface.md for people, interface.json for programs."""

from __future__ import annotations

import json
from dataclasses import asdict

from terrapin_interface.codec import NOTICE
from terrapin_interface.entries import Description, Message, Parameter

__all__ = ["as_json", "markdown"]


def as_json(d: Description) -> str:
    """Everything in the description, as JSON: the dataclasses of entries.py, field by field."""
    return json.dumps(asdict(d), indent=1, ensure_ascii=False) + "\n"


def _row(*cells: object) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


def _table(*columns: str) -> list[str]:
    return [_row(*columns), "|" + "---|" * len(columns)]


def _physical(raw: int, scale: float) -> str:
    return f"{raw * scale:.9g}"


def _exact(value: float) -> str:
    """A number as a program has to have it: a key has ten digits, a scale as many as a double.

    >>> _exact(2119673069.0), _exact(0.000030517578125)
    ('2119673069', '3.0517578125e-05')
    """
    return str(int(value)) if value == int(value) else repr(value)


def _message(d: Description, m: Message) -> list[str]:
    cycle = f"every {m.cycle_ms} ms" if m.cycle_ms else "when needed"
    protection = "; counter and CRC-8 (E2E)" if m.e2e else ""
    out = [f"### {m.name} (0x{m.id:03X})", "", m.comment, ""]
    out += [f"From {d.nodes[m.sender]}, {m.length} bytes, {cycle}{protection}.", ""]
    out += _table("signal", "bits", "raw range", "scale", "unit", "meaning")
    for s in m.signals:
        kind = "signed" if s.signed else "unsigned"
        bits = f"{s.start}" if s.length == 1 else f"{s.start} to {s.start + s.length - 1}, {kind}"
        meaning = s.comment or ("" if s.enum is None else f"enumeration `{s.enum}`")
        out.append(_row(f"`{s.name}`", bits, f"{s.minimum} to {s.maximum}", _exact(s.scale), s.unit, meaning))
    return [*out, ""]


def _parameter(p: Parameter) -> str:
    default, low, high = (_physical(raw, p.scale) for raw in (p.default, p.minimum, p.maximum))
    return _row(
        p.index,
        f"`{p.name}`",
        default,
        f"{low} to {high}",
        p.unit,
        f"{p.default}; {_exact(p.scale)}",
        f"{p.meaning}; its range ends at a ceiling: {p.ceiling}" if p.ceiling else p.meaning,
        p.protects,
    )


def markdown(d: Description, robot: str) -> str:
    """The reference page."""
    out = [f"<!-- {NOTICE} -->", f"# Interface of the controller ({d.name}, version {d.version})", ""]
    out += [f"Of robot `{robot}`: scales, ranges and defaults of other robots are others.", ""]
    out += [
        "Raw integers travel, little-endian: physical value = raw x scale. Encoders clamp and flag, they never wrap.",
        "Messages with E2E carry a counter that runs 0 to 14 (byte 6) and the CRC-8 of SAE J1850 over the data id (the",
        "CAN id, low byte first) and bytes 0 to 6 (byte 7), after AUTOSAR E2E profile 1.",
        "",
        "## Messages",
        "",
    ]
    for message in d.messages:
        out += _message(d, message)
    if d.blocks:
        out += ["## Identifiers of several controllers", ""]
        out += ["Those above are of node 0. The others have them by blocks; `broadcast` is the same for all.", ""]
        out += _table("node", *(block.name for block in d.blocks))
        for node in range(d.node_count):
            out.append(_row(node, *(f"0x{b.at(node):03X} to 0x{b.at(node) + b.size - 1:03X}" for b in d.blocks)))
        out.append("")
    out += ["## Enumerations", "", *_table("name", "values")]
    for name, values in d.enums.items():
        out.append(_row(f"`{name}`", ", ".join(f"{value} {key}" for key, value in values.items())))
    out += [
        "",
        "## Parameters",
        "",
        "Those that protect something are written only while the bridge is off. Physical values; the raw default",
        "stands apart.",
        "",
    ]
    out += _table("index", "name", "default", "range", "unit", "raw default; scale", "meaning", "protects")
    out += [_parameter(p) for p in d.parameters]
    out += [
        "",
        "## Faults",
        "",
        "Within: from the tick in which the cause first shows to the one that reacts, both counted. A scenario in",
        "hil/terrapin_hil/scenario/scenarios provokes it (`terrapin run NAME`) and checks that time.",
        "",
        *_table("bit", "name", "cause", "reaction", "within", "latched", "provoked by"),
    ]
    for f in sorted(d.faults, key=lambda fault: fault.number):
        scenarios = ", ".join(f"`{name}`" for name in f.scenarios)
        latched = "yes" if f.latched else "no"
        out.append(_row(f.number, f"`{f.name}`", f.cause, f.reaction, f"{f.within_ms} ms", latched, scenarios))
    for title, entries in (("Limits", d.limits), ("Constants", d.constants)):
        out += ["", f"## {title}", "", *_table("name", "value", "unit", "meaning")]
        out += [_row(f"`{x.name}`", _exact(x.value), x.unit, x.meaning) for x in entries]
    out += ["", "## Promises", "", *_table("name", "value", "unit", "meaning", "held by")]
    out += [_row(f"`{x.name}`", _exact(x.value), x.unit, x.meaning, f"`{x.test}`") for x in d.promises]
    return "\n".join(out) + "\n"
