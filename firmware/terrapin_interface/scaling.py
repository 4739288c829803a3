"""terrapin_scaling.h: from the core's units to the raw numbers of telemetry.

The core fills a struct with values as it has them; divisor, ceiling and width are the description's.
"""

from __future__ import annotations

from terrapin_interface.codec import NOTICE, c_kind
from terrapin_interface.entries import Description, Message, Signal

__all__ = ["scaling_header"]

_HEAD = f"""\
/* {NOTICE} */
#ifndef TERRAPIN_SCALING_H
#define TERRAPIN_SCALING_H

#include "terrapin_interface.h"

/* For each message that the controller sends in a cycle: what it is made of, in the core's units, and
 * terrapin_scale_..., which gives the raw numbers. They are cut towards zero to whole steps. What does not fit is
 * clamped and told by the encoder; where the description says `ceiling` it is held at the largest of its sign, which is
 * no fault. */
static inline int32_t terrapin_ceiling(int32_t value, int32_t low, int32_t high) {{
    const int32_t raised = (value < low) ? low : value;
    return (raised > high) ? high : raised;
}}

/* A count as a raw number, which a narrow signal clamps. */
static inline int32_t terrapin_count(uint32_t value) {{
    return (value > (uint32_t)INT32_MAX) ? INT32_MAX : (int32_t)value;
}}
"""


def scaling_header(d: Description) -> str:
    """Text of terrapin_scaling.h."""
    out = [_HEAD]
    for message in d.messages:
        if message.telemetry:
            out += [*_source(message), *_scale(message), ""]
    return "\n".join([*out, "#endif", ""])


def _kind(s: Signal) -> str:
    """Flags and counts have no unit and so no source; what has one, and an enumeration, is a number with a sign."""
    if s.source or s.enum is not None or s.signed:
        return c_kind(s)
    return "bool" if s.length == 1 else "uint32_t"


def _fields(message: Message) -> list[Signal]:
    """What the core fills; counter and CRC are the protection's."""
    return [s for s in message.signals if not (message.e2e and s.name in ("counter", "crc"))]


def _source(message: Message) -> list[str]:
    lines = [f"    {_kind(s)} {s.source or s.name};" for s in _fields(message)]
    return ["typedef struct {", *lines, f"}} terrapin_{message.name.lower()}_source;", ""]


def _scale(message: Message) -> list[str]:
    name = message.name.lower()
    lines = []
    for s in _fields(message):
        value = f"source->{s.source or s.name}"
        if _kind(s) == "bool":
            value += " ? 1 : 0"
        elif _kind(s) != c_kind(s):
            value = f"terrapin_count({value})"
        if s.divisor > 1:
            value += f" / {s.divisor}{'U' if c_kind(s) == 'uint32_t' else ''}"
        if s.ceiling and c_kind(s) == "int32_t":
            value = f"terrapin_ceiling({value}, {s.floor}, {s.maximum})"
        lines.append(f"        .{s.name} = {value},")
    return [
        f"static inline terrapin_{name}_t terrapin_scale_{name}(const terrapin_{name}_source *source) {{",
        f"    const terrapin_{name}_t message = {{",
        *lines,
        "    };",
        "    return message;",
        "}",
    ]
