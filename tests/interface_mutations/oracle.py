"""Is what was generated from a description right? Compiled, driven with the core's values, read by every decoder.

`wrong(text, folder)` builds what lies in `folder` (named "generated"; generate.py made it from `text`) and compares it
with the second reading of `text`: what telemetry.c sends of values in the core's units, as seen by the C decoder, the
simulator's Python, the logs' decoder and cantools; encoders and packers of every message at and beyond the edges of
every signal; random frames; counter and CRC; the tables of parameters; DBC and JSON word by word.
"""

from __future__ import annotations

import ctypes
import itertools
import json
import random
import re
import subprocess
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import cantools
import numpy as np

from terrapin_hil import paths
from terrapin_hil.messages import _interface
from terrapin_hil.telemetry import decode, si_factor
from terrapin_tools.logs.decoding import Decoder
from terrapin_tools.logs.frames import frames
from tests.interface_mutations.driver import CORE, PORT, RANGES, SLOTS, driver
from tests.interface_mutations.reference import Message, Reference, Signal, crc8, fnv, protected

__all__ = ["compile_core", "wrong"]

Sent = tuple[Message, dict[str, Fraction], bytes]  # with what the core meant, physical and exact, and the frame's data

COMPILER = ["cc", "-std=c11", "-O0", "-fPIC", "-Wall", "-Wextra", "-Wconversion", "-Wno-unused-function", "-Werror"]
FIRMWARE = paths.ROOT / "firmware"
VECTORS = 24  # of values, for each message
WIDE = 12
_NUMBERS = itertools.count()


class Wrong(AssertionError):
    """What was generated is not what the description says."""


def _need(good: bool, what: str) -> None:
    if not good:
        raise Wrong(what)


def compile_core(folder: Path) -> Path:
    """The object that telemetry.c needs and no description changes."""
    target = folder / "integer.o"
    subprocess.run([*COMPILER, "-c", FIRMWARE / "core" / "integer.c", "-o", target], check=True, timeout=60)
    return target


def wrong(text: str, folder: Path, integer: Path | None, only: str = "", seed: int = 1) -> str:
    """What is wrong with the generated files in `folder`, in one line; "" when nothing is. `integer`: compile_core's,
    where the description is the controller's and telemetry.c goes with it. `only`: a message that is all that changed.
    """
    r = Reference(text)
    messages = [m for m in r.messages if only in ("", m.name)]
    try:
        database: Any = cantools.database.load_file(folder / "terrapin.dbc")
    except Exception as error:
        return f"terrapin.dbc cannot be read: {error}"
    try:
        _json(r, folder)
        _plan(r, folder)
        _dbc(r, messages, database)
        library = _build(r, messages, folder, integer)
        generator = random.Random(seed)
        if not only:
            _tables(r, library)
            _protection(generator, library)
        for message in messages:
            _codec(message, library, generator)
            if message.telemetry:
                _scaling(message, library, generator)
        _frames(messages, folder, library, database, generator)
        if integer is not None:
            _telemetry([m for m in messages if m.name in ("ACTUATE", *SLOTS)], folder, library, database, generator)
    except Wrong as found:
        return str(found) or "wrong"
    return ""


def _build(r: Reference, messages: list[Message], folder: Path, integer: Path | None) -> ctypes.CDLL:
    source = folder / "driver.c"
    source.write_text(driver(r, messages, integer is not None))
    files = [source, folder / "terrapin_interface.c"]
    files += [FIRMWARE / "core" / "telemetry.c", integer] if integer else []
    target = folder / f"driver-{next(_NUMBERS)}.so"  # what was opened once is not opened anew under its name
    command = [*COMPILER, "-shared", f"-I{folder}", f"-I{FIRMWARE / 'core'}", *files, "-o", target]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    errors = [line for line in done.stderr.splitlines() if "error" in line or "undefined" in line]
    _need(done.returncode == 0, f"does not compile: {errors[0] if errors else done.stderr[-200:]}")
    library = ctypes.CDLL(str(target))
    target.unlink()
    return library


# ---------------------------------------------------------------- calls


def _words(values: list[int]) -> Any:
    return (ctypes.c_int64 * len(values))(*values)


def _call(function: Any, values: list[int]) -> tuple[int, int, bytes, int]:
    """(identifier, length, 8 bytes, what the function returned)"""
    out = (ctypes.c_uint8 * 11)()
    told = function(_words(values), out)
    data = bytes(out)
    return data[0] | data[1] << 8, data[2], data[3:], told


def _edges(s: Signal, one: Fraction, low: int, high: int, generator: random.Random) -> list[int]:
    """Values of a source at and beyond the ends of its signal, around 0, and anywhere; within `low`..`high`."""
    step = s.scale / one
    places = [int(raw * step) for raw in (s.minimum, s.maximum, -s.maximum, 0, generator.randint(s.minimum, s.maximum))]
    near = (0, 1, -1, int(step), -int(step), int(step) - 1, 1 - int(step), 2 * int(step), -2 * int(step))
    found = [place + off for place, off in itertools.product(places, near)]
    found += [low, high, generator.randint(low, high)]
    return [value for value in found if low <= value <= high]


def _vectors(choices: list[list[int]], generator: random.Random) -> Iterator[list[int]]:
    """Each choice at least once, the others beside it at random."""
    for number in range(max(VECTORS, max(map(len, choices)))):
        yield [
            options[number % len(options)] if number % len(choices) == place else generator.choice(options)
            for place, options in enumerate(choices)
        ]


def _word_range(s: Signal) -> tuple[int, int]:
    return RANGES["uint32_t" if s.unsigned_word else "int32_t"]


# ---------------------------------------------------------------- codec, scaling


def _codec(m: Message, library: ctypes.CDLL, generator: random.Random) -> None:
    name = m.name.lower()
    choices = [_edges(s, s.scale, *_word_range(s), generator) for s in m.signals]
    for values in _vectors(choices, generator):
        held = {s.name: s.held(value) for s, value in zip(m.signals, values, strict=True)}
        fits = [held[s.name] for s in m.signals] == values
        for way in ("encode", "pack"):
            found = _call(getattr(library, f"{way}_{name}"), values)
            _need(found == (m.id, m.length, m.pack(held), int(fits)), f"{way} {m.name}: {values} gives {found}")
    for _ in range(WIDE):
        data = generator.randbytes(8)
        out = _words([-1] * len(m.signals))
        told = getattr(library, f"decode_{name}")(m.id, m.length, data[: m.length].ljust(8, b"\0"), out)
        _need(
            (told, list(out)) == (1, list(m.unpack(data).values())), f"decode {m.name}: {data.hex()} gives {list(out)}"
        )
    for identifier, length in ((m.id ^ 1, m.length), (m.id, m.length - 1)):
        told = getattr(library, f"decode_{name}")(identifier, length, bytes(8), _words([0] * len(m.signals)))
        _need(told == 0, f"decode {m.name} takes another's frame")


def _scaling(m: Message, library: ctypes.CDLL, generator: random.Random) -> None:
    """From the source's struct, by the units that [suffix] gives; a port's by the oracle's own."""
    own = [PORT.get(f"{m.name}.{s.name}", s.one or s.scale) for s in m.own]
    ranges = [RANGES[s.kind] for s in m.own]
    choices = [_edges(s, one, *limits, generator) for s, one, limits in zip(m.own, own, ranges, strict=True)]
    for values in _vectors(choices, generator):
        shown = {s.name: s.shown(value, one) for s, value, one in zip(m.own, values, own, strict=True)}
        data = m.pack({name: raw for name, (raw, _) in shown.items()})
        fits = all(good for _, good in shown.values())
        found = _call(getattr(library, f"scale_{m.name.lower()}"), values)
        _need(found == (m.id, m.length, data, int(fits)), f"scale {m.name}: {values} gives {found}")


# ---------------------------------------------------------------- what telemetry.c sends, in every decoder


def _visible(m: Message, values: Mapping[str, int]) -> dict[str, Fraction]:
    """What the core means by its values: physical, exact. Signals that depend on another as telemetry.c says."""
    found = {s.name: values[s.name] * CORE[f"{m.name}.{s.name}"][2] for s in m.own if s.name in values}
    if m.name == "GROUND" and not values["valid"]:
        found |= {"terrain": Fraction(0), "margin": Fraction(0)}
    if m.name == "FIT" and not values["windows"]:
        found |= {"f_o_sd": Fraction(10**9), "f_s_sd": Fraction(10**9)}
    return found


def _good(s: Signal, meant: Fraction, seen: float) -> bool:
    """What is sent is cut towards zero to whole steps. A decoded value so stands for the step from it away from zero,
    whose middle is within half a step of what was meant; beyond the range it is the range's end."""
    low = max(s.minimum, -s.maximum) if s.ceiling else s.minimum
    step, value = float(s.scale), float(meant)
    slack = 1e-6 * step + 1e-12 * abs(seen)
    if not (low - 1) * step + slack < value < (s.maximum + 1) * step - slack:  # beyond the range
        return abs(seen - (low if value < 0 else s.maximum) * step) <= slack
    same_side = seen == 0.0 or (seen > 0) == (value > 0)
    return same_side and abs(seen) <= abs(value) + slack and abs(value) < abs(seen) + step + slack


def _telemetry(
    messages: list[Message], folder: Path, library: ctypes.CDLL, database: Any, generator: random.Random
) -> None:
    sent: list[Sent] = []
    for m in messages:
        name = m.name
        kinds = [CORE.get(f"{name}.{s.name}", ("", "int32_t", s.scale)) for s in m.own]
        choices = [_edges(s, one, *RANGES[kind], generator) for s, (_, kind, one) in zip(m.own, kinds, strict=True)]
        for values in _vectors(choices, generator):
            values = [value & ~1 if s.name == "tick" else value for s, value in zip(m.own, values, strict=True)]
            identifier, length, data, _ = _call(getattr(library, f"send_{name.lower()}"), values)
            _need((identifier, length) == (m.id, m.length), f"telemetry.c sends {identifier:#x} for {name}")
            _need(not m.table.get("e2e") or data == protected(m.id, data, data[6] & 15), f"{name}: counter and CRC")
            known = {s.name: value for s, value in zip(m.own, values, strict=True) if f"{name}.{s.name}" in CORE}
            sent.append((m, _visible(m, known), data))
    for who, message, decoded in _decoders(folder, library, database, sent) if sent else ():
        mine = [(meant, data) for m, meant, data in sent if m is message]
        for (meant, data), seen in zip(mine, decoded, strict=True):
            for s in message.own:
                if s.name in meant and not _good(s, meant[s.name], seen[s.name]):
                    value = float(meant[s.name])
                    raise Wrong(f"{message.name}.{s.name}: {value:.9g} is {seen[s.name]:.9g} in {who} ({data.hex()})")


def _decoders(
    folder: Path, library: ctypes.CDLL, database: Any, sent: list[Sent]
) -> Iterator[tuple[str, Message, list[dict[str, float]]]]:
    """(decoder, message, physical values of each frame in order)"""
    ours = _interface.__wrapped__(folder.parent)
    identifiers = [m.id for m, _, _ in sent]
    payloads = [data[: m.length] for m, _, data in sent]
    times = np.arange(float(len(sent)))
    log = Decoder(folder / "terrapin.dbc").decode(frames(folder, times, identifiers, payloads, [0] * len(sent)))
    bytes_ = np.frombuffer(b"".join(data for _, _, data in sent), dtype=np.uint8).reshape(-1, 8)
    live = decode(ours, times, np.array(identifiers), bytes_)
    for message in {m.name: m for m, _, _ in sent}.values():
        mine = [data[: m.length] for m, _, data in sent if m is message]
        entry = database.get_message_by_name(message.name)
        yield "cantools", message, [entry.decode(data, decode_choices=False) for data in mine]
        yield "messages.py", message, [ours.messages[message.name].physical(data) for data in mine]
        columns = log[message.name].signals
        yield "logs", message, [{k: float(v[i]) for k, v in columns.items()} for i in range(len(mine))]
        table = live[message.name]
        factor = {s.name: si_factor(s.unit) for s in message.signals}
        yield (
            "telemetry.py",
            message,
            [{name: float(table[name][i]) / factor[name] for name in factor} for i in range(len(mine))],
        )
        out = _words([0] * len(message.signals))
        values = []
        for data in mine:
            getattr(library, f"decode_{message.name.lower()}")(message.id, message.length, data.ljust(8, b"\0"), out)
            values.append({s.name: out[i] * float(s.scale) for i, s in enumerate(message.signals)})
        yield "C", message, values


def _frames(
    messages: list[Message], folder: Path, library: ctypes.CDLL, database: Any, generator: random.Random
) -> None:
    """Random frames of every message, raw, in Python and cantools."""
    ours = _interface.__wrapped__(folder.parent)
    for m in messages:
        entry = database.get_message_by_name(m.name)
        for _ in range(3):
            data = generator.randbytes(m.length)
            expected = m.unpack(data.ljust(8, b"\0"))
            _need(ours.messages[m.name].decode(data) == expected, f"messages.py reads {m.name} {data.hex()} otherwise")
            seen = entry.decode(data, decode_choices=False, scaling=False)
            _need(seen == expected, f"cantools reads {m.name} {data.hex()} otherwise")


# ---------------------------------------------------------------- tables, protection, DBC, JSON


def _tables(r: Reference, library: ctypes.CDLL) -> None:
    class Entry(ctypes.Structure):
        _fields_ = [(name, ctypes.c_int32) for name in ("default_value", "minimum", "maximum")]

    library.terrapin_parameter.restype = Entry
    library.terrapin_parameter_protected.restype = ctypes.c_bool
    table = r.toml.get("parameter", {})
    hashes = (ctypes.c_uint32 * len(table)).in_dll(library, "terrapin_parameter_hashes") if table else ()
    for index, (name, e) in enumerate(table.items()):
        found = library.terrapin_parameter(index)
        numbers = (found.default_value, found.minimum, found.maximum)
        _need(numbers == (e["default"], e["min"], e["max"]), f"parameter {name}: {numbers}")
        guarded = library.terrapin_parameter_protected(index)
        _need(guarded == bool(e.get("protects")), f"parameter {name}: protected {guarded}")
        wanted = fnv(name, e.get("unit", ""), float(e.get("scale", 1.0)))
        _need(hashes[index] == wanted, f"parameter {name}: hash {hashes[index]:#x}")
    if table:
        _all_parameters(list(table.values()), library)


def _all_parameters(entries: list[dict[str, int]], library: ctypes.CDLL) -> None:
    """All defaults at once, and which values are in range: nothing beside them is written or read."""
    library.terrapin_parameters_in_range.restype = ctypes.c_bool
    size = len(entries) + 2
    for beside in (-(2**31), 2**31 - 1):  # before and after the values
        values = (ctypes.c_int32 * size)(*[beside] * size)
        inner = ctypes.byref(values, ctypes.sizeof(ctypes.c_int32))
        library.terrapin_parameter_defaults(inner)
        _need(list(values) == [beside, *(e["default"] for e in entries), beside], "defaults of all parameters")
        for key, further in (("min", -1), ("max", 1)):
            edges = [e[key] for e in entries]
            values[1:-1] = edges
            _need(library.terrapin_parameters_in_range(inner), f"parameters at their {key} are in range")
            for index, edge in enumerate(edges):
                if not -(2**31) <= edge + further < 2**31:
                    continue
                values[1 + index] = edge + further
                _need(not library.terrapin_parameters_in_range(inner), f"parameter {index} beyond its {key}")
                values[1 + index] = edge


def _protection(generator: random.Random, library: ctypes.CDLL) -> None:
    library.terrapin_crc8.restype = ctypes.c_uint8
    for length in range(12):
        data, start = generator.randbytes(length), generator.randrange(256)
        seen = library.terrapin_crc8(start, data, ctypes.c_size_t(length))
        _need(seen == crc8(start, data), f"CRC of {data.hex()}: {seen}")
    for counter in (*range(32), 2**32 - 1):
        identifier, data = generator.randrange(0x800), generator.randbytes(8)
        frame = (ctypes.c_uint8 * 8)(*data)
        library.e2e_protect(identifier, frame, ctypes.c_uint32(counter))
        sound = bytes(frame)
        _need(sound == protected(identifier, data, counter), f"protection of {identifier:#x} {data.hex()}")
        high = bytes([*sound[:6], sound[6] | 0xF, 0])
        high = high[:7] + bytes([crc8(0, [identifier & 0xFF, identifier >> 8, *high[:7]])])
        flipped = bytearray(sound)
        flipped[generator.randrange(8)] ^= 1 << generator.randrange(8)
        cases = ((sound, 8, 255, 0), (sound, 8, counter % 15, 2), (sound, 7, 255, 1), (high, 8, 255, 1))
        for frame_data, length, last, expected in (*cases, (bytes(flipped), 8, 255, 1)):
            kept = ctypes.c_uint8(last)
            told = library.e2e_check(identifier, length, bytes(frame_data), ctypes.byref(kept))
            after = counter % 15 if expected == 0 else last
            _need((told, kept.value) == (expected, after), f"check of {frame_data.hex()}: {told}, {kept.value}")


def _json(r: Reference, folder: Path) -> None:
    said, wanted = json.loads((folder / "interface.json").read_text(encoding="utf-8")), r.json()
    for key in wanted.keys() | said.keys():
        _need(said.get(key) == wanted.get(key), f"interface.json: {key}")


def _plan(r: Reference, folder: Path) -> None:
    """The plan of identifiers as link/node.c reads it."""
    header = (folder / "terrapin_interface.h").read_text(encoding="utf-8")
    text = re.findall(r"^#define TERRAPIN_BLOCKS (.*)$", header, re.M)
    numbers = [int(number, 0) for number in re.findall(r"\b(0x[0-9A-F]+|[0-9]+)U", "".join(text))]
    rows = [tuple(numbers[i : i + 6]) for i in range(0, len(numbers), 6)]
    _need(rows == r.rows_of_blocks(), f"TERRAPIN_BLOCKS: {text}")
    if not r.blocks:
        return
    received = sum(b["sender"] != "controller" for b in r.blocks)
    for name, value in (("NODES", r.nodes), ("BLOCK_COUNT", len(r.blocks)), ("BLOCK_RECEIVED", received)):
        _need(f"#define TERRAPIN_{name} {value}U\n" in header, f"TERRAPIN_{name}")


def _dbc(r: Reference, messages: list[Message], database: Any) -> None:
    wanted = r.json()
    _need(database.version == f"{wanted['name']} {wanted['version']}", "DBC: version")
    _need([m.name for m in database.messages] == [m.name for m in r.messages], "DBC: messages")
    _need([node.name for node in database.nodes] == list(wanted["nodes"].values()), "DBC: nodes")
    for m in messages:
        entry = database.get_message_by_name(m.name)
        others = {node for role, node in wanted["nodes"].items() if role != m.table["sender"]}
        said = (entry.frame_id, entry.length, entry.senders, entry.cycle_time or 0, entry.comment or "")
        sender = wanted["nodes"][m.table["sender"]]
        comment = m.table.get("comment", "").replace('"', "'")
        _need(said == (m.id, m.length, [sender], m.table.get("cycle_ms", 0), comment), f"DBC: {m.name}: {said}")
        entries = {s.name: s for s in entry.signals}
        _need(entries.keys() == {s.name for s in m.signals}, f"DBC: signals of {m.name}")
        for s in m.signals:
            e = entries[s.name]
            choices = r.toml["enum"][s.enum]["values"] if s.enum else {}
            said = (
                e.start, e.length, e.is_signed, e.byte_order, float(e.scale), float(e.offset), e.unit or "",
                e.comment or "", set(e.receivers), {str(v): int(k) for k, v in (e.choices or {}).items()},
            )  # fmt: skip
            meant = (
                s.start, s.length, s.signed, "little_endian", float(s.scale), 0.0, s.unit,
                s.comment.replace('"', "'"), others, dict(choices),
            )  # fmt: skip
            _need(said == meant, f"DBC: {m.name}.{s.name}: {said}, expected {meant}")
            ends = [float(e.minimum if e.minimum is not None else 0), float(e.maximum if e.maximum is not None else 0)]
            wide = [float(s.minimum * s.scale), float(s.maximum * s.scale)]
            _need(bool(np.allclose(ends, wide, rtol=1e-12, atol=0)), f"DBC: range of {m.name}.{s.name}: {ends}")
