"""controller.toml read a second time, in exact numbers, and without terrapin_interface but for one hash."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

from terrapin_interface.fitting import fitted, interface_identity

__all__ = ["Message", "Reference", "Signal", "crc8", "fnv", "protected"]


@dataclass(frozen=True)
class Signal:
    name: str
    start: int
    length: int
    signed: bool
    scale: Fraction
    unit: str
    minimum: int
    maximum: int
    enum: str | None
    comment: str
    source: str
    one: Fraction | None  # of the source, in the signal's unit
    ceiling: bool

    @property
    def unsigned_word(self) -> bool:
        return self.length == 32 and not self.signed

    @property
    def kind(self) -> str:
        """Of the field that the core fills."""
        if self.source or self.enum or self.signed:
            return "uint32_t" if self.unsigned_word else "int32_t"
        return "bool" if self.length == 1 else "uint32_t"

    @property
    def divisor(self) -> int:
        if self.one is None:
            return 1
        divisor = self.scale / self.one
        assert abs(divisor - round(divisor)) < Fraction(1, 10**6), "not whole: the generator should have refused it"
        return round(divisor)

    def held(self, raw: int) -> int:
        return min(max(raw, self.minimum), self.maximum)

    def shown(self, value: int, one: Fraction | None = None) -> tuple[int, bool]:
        """Raw number of `value` in units of its source, and whether it counts as fitting."""
        steps = Fraction(value) * (one if one is not None else self.one or self.scale) / self.scale
        raw = int(steps)  # towards zero
        if self.ceiling:
            return min(max(raw, self.minimum, -self.maximum), self.maximum), True
        return self.held(raw), self.held(raw) == raw


@dataclass(frozen=True)
class Message:
    name: str
    table: Mapping[str, Any]
    signals: tuple[Signal, ...]

    @property
    def id(self) -> int:
        return int(self.table["id"])

    @property
    def length(self) -> int:
        return int(self.table.get("length", max((s.start + s.length + 7) // 8 for s in self.signals)))

    @property
    def telemetry(self) -> bool:
        return self.table["sender"] == "controller" and self.table.get("cycle_ms", 0) > 0

    @property
    def own(self) -> tuple[Signal, ...]:
        """Without what the protection fills."""
        e2e = self.table.get("e2e", False)
        return tuple(s for s in self.signals if not (e2e and s.name in ("counter", "crc")))

    def pack(self, raw: Mapping[str, int]) -> bytes:
        bits = 0
        for s in self.signals:
            for i in range(s.length):
                bits |= (raw.get(s.name, 0) >> i & 1) << (s.start + i)
        return bits.to_bytes(8, "little")

    def unpack(self, data: bytes) -> dict[str, int]:
        found = {}
        for s in self.signals:
            value = sum((data[(s.start + i) // 8] >> (s.start + i) % 8 & 1) << i for i in range(s.length))
            found[s.name] = value - (1 << s.length) if s.signed and value >> (s.length - 1) else value
        return found


# What the cylinder's numbers were before they stood in its file: every `default` or `value` in quotes, raw.
CYLINDER = {
    "radius": 80000, "drive_radius": 18000, "ground_wheel_radius": 30000, "weight": 18639, "inertia": 17636,
    "inertia_shell": 14880, "inertia_swing": 7936, "torque_constant": 100000, "armature_resistance": 5000,
    "gear_efficiency": 1000000, "driven_efficiency": 1000000,
    "coulomb": 12000, "viscous": 100000, "current_scale": 1000, "supply_scale": 4000, "window": 300, "gate": 400,
    "slip_limit": 5000, "voltage_limit": 10000, "current_limit": 1800, "over_current": 2000, "supply_low": 6000,
    "supply_high": 15000, "temperature_high": 120000, "encoder_jump": 200, "encoder_counts": 2048, "encoder_divider": 1,
    "record_interval": 10,
    "robot_identity": 0x1EBF42, "robot_board": 1, "swing_limit": 0,
}  # fmt: skip


class Reference:
    """A description that was accepted, for the cylinder."""

    def __init__(self, text: str) -> None:
        self.toml = tomllib.loads(text, parse_float=Decimal)
        for name, board in self.toml.get("ceiling", {}).items():  # narrows the range
            self.toml["parameter"][name] |= {k: board[k] for k in ("min", "max") if k in board} | {
                "ceiling": board["part"]
            }
        for kind, key in (("parameter", "default"), ("limit", "value"), ("constant", "value")):
            for entry in self.toml.get(kind, {}).values():
                entry[key] = CYLINDER.get(entry[key], entry[key])
        for entry in self.toml.get("constant", {}).values():
            if entry["value"] == "interface_identity":  # a hash of what the file says: there is no second way to it
                entry["value"] = interface_identity(fitted(tomllib.loads(text)))
        self.messages = [self._message(name, table) for name, table in self.toml.get("message", {}).items()]
        plan = self.toml.get("identifiers", {"nodes": 1, "blocks": []})
        self.nodes: int = plan["nodes"]
        self.blocks = [{"node_1": b["first"], "step": 0} | b for b in plan["blocks"]]

    def rows_of_blocks(self) -> list[tuple[int, ...]]:
        """TERRAPIN_BLOCKS: first, node 1, step, size, and the protected identifiers, in two words; what a controller
        receives comes first."""
        rows = []
        for role in (False, True):
            for b in self.blocks:
                if (b["sender"] == "controller") == role:
                    own = [
                        b["first"] + i in (m.id for m in self.messages if m.table.get("e2e", False)) for i in range(64)
                    ]
                    own[b["size"] :] = [False] * (64 - b["size"])
                    words = [int("".join("01"[bit] for bit in reversed(half)), 2) for half in (own[:32], own[32:])]
                    rows.append((b["first"], b["node_1"], b["step"], b["size"], *words))
        return rows

    def _message(self, name: str, table: Mapping[str, Any]) -> Message:
        return Message(name, table, tuple(self._signal(entry) for entry in table["signals"]))

    def _signal(self, entry: Mapping[str, Any]) -> Signal:
        signed, length = entry.get("signed", False), entry["length"]
        low, high = (-(2 ** (length - 1)), 2 ** (length - 1) - 1) if signed else (0, 2**length - 1)
        source = entry.get("source", "")
        known = [key for key in self.toml.get("suffix", {}) if source.endswith("_" + key)]
        return Signal(
            entry["name"], entry["start"], length, signed, Fraction(entry.get("scale", 1)), entry.get("unit", ""),
            entry.get("min", low), entry.get("max", high), entry.get("enum"), entry.get("comment", ""), source,
            Fraction(self.toml["suffix"][max(known, key=len)][0]) if known else None, entry.get("ceiling", False),
        )  # fmt: skip

    def json(self) -> dict[str, Any]:
        """What interface.json must say."""
        t = self.toml
        nodes = {role: str(node) for role, node in t["node"].items()}

        def signal(s: Signal) -> dict[str, Any]:
            fields = ("name", "start", "length", "signed", "unit", "minimum", "maximum", "enum", "comment", "source")
            return {name: getattr(s, name) for name in fields} | {
                "scale": float(s.scale), "divisor": s.divisor, "ceiling": s.ceiling
            }  # fmt: skip

        def constants(kind: str, *more: str) -> list[dict[str, Any]]:
            return [
                {
                    "name": n,
                    "value": float(e["value"]),
                    "unit": e.get("unit", ""),
                    "meaning": e["meaning"],
                }
                | {key: e[key] for key in more}
                for n, e in t.get(kind, {}).items()
            ]

        return {
            **{key: t["controller"][key] for key in ("name", "version", "tick_hz")},
            "nodes": nodes,
            "node_count": self.nodes,
            "blocks": self.blocks,
            "enums": {name: entry["values"] for name, entry in t.get("enum", {}).items()},
            "messages": [
                {
                    "name": m.name, "id": m.id, "sender": m.table["sender"], "length": m.length,
                    "cycle_ms": m.table.get("cycle_ms", 0), "e2e": m.table.get("e2e", False),
                    "comment": m.table.get("comment", ""), "authority": m.table.get("authority", ""),
                    "signals": [signal(s) for s in m.signals],
                }
                for m in self.messages
            ],
            "parameters": [
                {
                    "name": name, "index": index, "default": e["default"], "minimum": e["min"], "maximum": e["max"],
                    "unit": e.get("unit", ""), "scale": float(e.get("scale", 1.0)), "meaning": e["meaning"],
                    "protects": e.get("protects", ""), "ceiling": e.get("ceiling", ""),
                }
                for index, (name, e) in enumerate(t.get("parameter", {}).items())
            ],
            "faults": [
                {key: e[key] for key in ("number", "cause", "reaction", "latched", "within_ms")}
                | {"name": name, "scenarios": e.get("scenarios", [])}
                for name, e in t.get("fault", {}).items()
            ],
            "limits": constants("limit"),
            "constants": constants("constant"),
            "promises": constants("promise", "test"),
        }  # fmt: skip


def crc8(crc: int, data: Sequence[int]) -> int:
    """CRC-8 SAE J1850, bit by bit, continued from `crc`."""
    value = crc ^ 0xFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ 0x1D) & 0xFF if value & 0x80 else value << 1
    return value ^ 0xFF


def protected(identifier: int, data: bytes, counter: int) -> bytes:
    body = data[:6] + bytes([data[6] & 0xF0 | counter % 15])
    return body + bytes([crc8(0, [identifier & 0xFF, identifier >> 8, *body])])


def fnv(name: str, unit: str, scale: float) -> int:
    value = 2166136261
    for byte in f"{name}|{unit}|{scale!r}".encode():
        value = (value ^ byte) * 16777619 % 2**32
    return value
