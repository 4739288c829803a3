"""The description as a DBC, which any CAN tool reads."""

from __future__ import annotations

from decimal import Decimal

from terrapin_interface.entries import Description, Message, Signal

__all__ = ["dbc"]


def _number(value: float) -> str:
    """Shortest decimal that reads back as the same double, without an exponent."""
    return format(Decimal(repr(value)) if isinstance(value, float) else Decimal(value), "f").removesuffix(".0")


def _text(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', "'") + '"'


def _signal(signal: Signal, receiver: str) -> str:
    scale = _number(signal.scale)
    low, high = (_number(float(Decimal(repr(signal.scale)) * raw)) for raw in (signal.minimum, signal.maximum))
    sign = "-" if signal.signed else "+"
    return (
        f" SG_ {signal.name} : {signal.start}|{signal.length}@1{sign} ({scale},0) [{low}|{high}] "
        f"{_text(signal.unit)} {receiver}"
    )


def _comment(d: Description, signal: Signal) -> str:
    """What a signal is; of a field of fault bits also which bit is which fault."""
    if signal.name != "faults":
        return signal.comment
    return f"{signal.comment}: {', '.join(f'bit {fault.number} {fault.name}' for fault in d.faults)}"


def dbc(d: Description, robot: str) -> str:
    """Text of the DBC: whose controller's it is, messages, units, comments, value tables and cycle times."""
    nodes = list(d.nodes.values())

    def receiver(message: Message) -> str:
        return ",".join(node for node in nodes if node != d.nodes[message.sender]) or "Vector__XXX"

    out = ['VERSION "' + f"{d.name} {d.version}" + '"', "", "NS_ :", "", "BS_:", "", "BU_: " + " ".join(nodes), ""]
    for m in d.messages:
        out.append(f"BO_ {m.id} {m.name}: {m.length} {d.nodes[m.sender]}")
        out += [*(_signal(s, receiver(m)) for s in m.signals), ""]
    out.append(f"CM_ {_text(f'Controller of robot {robot}: the scales are those of this robot, others have others.')};")
    for m in d.messages:
        if m.comment:
            out.append(f"CM_ BO_ {m.id} {_text(m.comment)};")
        out += [f"CM_ SG_ {m.id} {s.name} {_text(_comment(d, s))};" for s in m.signals if s.comment]
    out += ['BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;', 'BA_DEF_DEF_ "GenMsgCycleTime" 0;']
    out += [f'BA_ "GenMsgCycleTime" BO_ {m.id} {m.cycle_ms};' for m in d.messages if m.cycle_ms]
    for m in d.messages:
        for s in m.signals:
            if s.enum is not None:
                values = " ".join(f'{value} "{key}"' for key, value in d.enums[s.enum].items())
                out.append(f"VAL_ {m.id} {s.name} {values} ;")
    return "\n".join(out) + "\n"
