"""A small description that is good, and edits of it that must be refused: (old, new, part of the one line)."""

from __future__ import annotations

__all__ = ["GOOD", "PLANTED", "big"]

_PLAN = """[identifiers]
nodes = 3
blocks = [
  { name = "asked", sender = "host", first = 0x10, size = 1, node_1 = 0x20, step = 0x01 },
  { name = "told", sender = "controller", first = 0x11, size = 1, node_1 = 0x31, step = 0x01 },
  { name = "wide", sender = "controller", first = 0x12, size = 2, node_1 = 0x42, step = 0x02 },
  { name = "more", sender = "controller", first = 0x14, size = 4, node_1 = 0x54, step = 0x04 },
  { name = "all", sender = "host", first = 0x7FF, size = 1 },
]
"""

GOOD = f"""
[controller]
name = "toy"
version = 0
tick_hz = 1000
{_PLAN}[node]
controller = "CTRL"
host = "HOST"
[suffix]
hv = [0.5, "V"]
mv = [1e-3, "V"]
10mv = [1e-2, "V"]
[enum.mode]
values = {{ off = 0, on = 1, both = 2 }}
[message.ONE]
id = 0x10
sender = "host"
cycle_ms = 5
e2e = true
signals = [
  {{ name = "mode", start = 0, length = 2, enum = "mode" }},
  {{ name = "level", start = 2, length = 10, signed = true, scale = 0.5, unit = "V", source = "u_hv", min = -100, max = 100 }},
  {{ name = "counter", start = 48, length = 4 }},
  {{ name = "crc", start = 56, length = 8 }},
]
[message.TWO]
id = 0x11
sender = "controller"
signals = [ {{ name = "wide", start = 8, length = 32 }}, {{ name = "tail", start = 40, length = 3, min = 1, max = 6 }} ]
[message.THREE]
id = 0x12
sender = "controller"
cycle_ms = 10
signals = [
  {{ name = "volts", start = 0, length = 8, signed = true, scale = 0.02, unit = "V", source = "volts_10mv" }},
  {{ name = "peak", start = 8, length = 8, signed = true, scale = 0.02, unit = "V", source = "peak_mv", ceiling = true }},
  {{ name = "hot", start = 16, length = 1 }},
  {{ name = "few", start = 17, length = 2 }},
]
[message.FOUR]
id = 0x14
sender = "controller"
signals = [ {{ name = "upper", start = 32, length = 1 }} ]
[message.FIVE]
id = 0x15
sender = "controller"
signals = [ {{ name = "last", start = 31, length = 1 }} ]
[parameter.gain]
default = 5
min = -3
max = 9
unit = "V"
scale = 0.001
meaning = "a gain"
protects = "the motor"
[fault.hot]
number = 3
cause = "too hot"
reaction = "bridge off"
within_ms = 3
latched = true
scenarios = ["heat"]
[fault.cold]
number = 4
cause = "too cold"
reaction = "none"
within_ms = 10
latched = false
[limit.top]
value = 7
unit = "V"
meaning = "the top"
[constant.key]
value = 0x1234
meaning = "a key"
[promise.reach]
value = 3
unit = "m"
meaning = "the reach"
test = "tests/test_reach.py::test_reach"
"""  # noqa: E501


def _plan(nodes: int, *blocks: str) -> tuple[str, str]:
    """Another [identifiers] in the place of the good one."""
    listed = ", ".join(f"{{ {block} }}" for block in blocks)
    return _PLAN, f"[identifiers]\nnodes = {nodes}\nblocks = [ {listed} ]\n"


_ASKED = 'name = "asked", sender = "host", first = 0x10'
_TOLD = 'name = "told", sender = "controller", first = 0x11'

PLANTED = [
    (*_plan(2, 'sender = "host", first = 0x10, size = 1'), "[identifiers], block number 1: 'name' is missing"),
    (*_plan(0, f"{_ASKED}, size = 1"), "[identifiers]: 'nodes' must be 1 to 16, found 0"),
    (*_plan(17, f"{_ASKED}, size = 1"), "[identifiers]: 'nodes' must be 1 to 16, found 17"),
    (*_plan(2, f"{_ASKED}, size = 0"), "block asked: 'size' must be 1 to 64, found 0"),
    (*_plan(2, f"{_ASKED}, size = 128"), "block asked: 'size' must be 1 to 64, found 128"),
    (*_plan(2, f"{_ASKED}, size = 6"), "block asked: 'size' 6 must be a power of 2"),
    (*_plan(2, f"{_ASKED}, size = 16, node_1 = 0x28, step = 16"), "and 'first', 'node_1' and 'step' multiples of it"),
    (*_plan(2, f"{_ASKED}, size = 1, node_1 = 0x20"), "'node_1' and 'step' must be given together"),
    (*_plan(2, f"{_ASKED}, size = 1, node_1 = -1"), "block asked: 'node_1' must be 0 to 2047, found -1"),
    (*_plan(2, f"{_ASKED}, size = 1, step = -1"), "block asked: 'step' must be 0 to 2047, found -1"),
    (*_plan(2, 'name = "a", sender = "host", first = 0x800, size = 1'), "'first' must be 0 to 2047, found 2048"),
    (*_plan(2, f"{_ASKED}, size = 8"), "message TWO: id 0x011 is in no block of [identifiers] of its sender's"),
    (
        *_plan(2, f"{_ASKED}, size = 1", f"{_TOLD}, size = 1"),
        "message THREE: id 0x012 is in no block of [identifiers] of its sender's",
    ),
    (
        *_plan(2, f"{_ASKED}, size = 1, node_1 = 0x11, step = 1", f"{_TOLD}, size = 1"),
        "block told, node 0: id 0x011 is already taken by block asked, node 1",
    ),
    (
        *_plan(3, f"{_ASKED}, size = 8, node_1 = 0x7F8, step = 8"),
        "block asked: node 2 goes beyond 0x7FF, the last identifier",
    ),
    ("start = 2, length = 10", "start = 1, length = 10", "signal level: 'start' 1, 'length' 10: bit 1 overlaps"),
    ("start = 8, length = 32", "start = 40, length = 32", "signal wide: 'start' 40, 'length' 32: bits 40 to 71"),
    ("length = 32", "length = 31", "signal wide: 'length' must be at most 30, or 32, of an unsigned signal, found 31"),
    ("length = 32", "length = 33", "message TWO, signal wide: 'length' must be 1 to 32, found 33"),
    ("length = 10, signed", "length = 1, signed", "signal level: 'length' must be at least 2 of a signed signal"),
    ("length = 10, signed", "length = 0, signed", "message ONE, signal level: 'length' must be 1 to 32, found 0"),
    ('enum = "mode"', 'enum = "moode"', "message ONE, signal mode: unknown enum 'moode' (known: mode)"),
    ("length = 2, enum", "length = 1, enum", "signal mode: 'length' 1: enum 'mode' needs an unsigned signal"),
    ("id = 0x11", "id = 0x10", "message TWO: id 0x010 is already taken by message ONE"),
    ("id = 0x11", "id = 0x800", "message TWO: 'id' must be 0 to 2047, found 2048"),
    ("id = 0x11", 'id = "11"', "message TWO: 'id' must be an integer, found '11'"),
    ("id = 0x11", "id = true", "message TWO: 'id' must be an integer, found True"),
    ("id = 0x11\n", "", "message TWO: 'id' is missing"),
    (
        'id = 0x11\nsender = "controller"',
        'id = 0x11\nsender = "cat"',
        "message TWO: sender 'cat' is no node (known: controller, host)",
    ),
    ("min = -100", "min = -600", "message ONE, signal level: 'min' must be -512 to 511, found -600"),
    ("max = 100 }", "max = -101 }", "message ONE, signal level: 'max' must be -100 to 511, found -101"),
    ("scale = 0.5", "scale = 0.0", "message ONE, signal level: 'scale' must be a positive number, found 0.0"),
    ("scale = 0.5", "scale = nan", "message ONE, signal level: 'scale' must be a positive number, found nan"),
    ("scale = 0.5", "skale = 0.5", "message ONE, signal level: unknown key 'skale'"),
    ('name = "tail"', 'name = "WIDE"', "signal WIDE: name wide is already taken by message TWO, signal wide"),
    ('name = "tail"', 'name = "int"', "message TWO, signal number 2: 'int' cannot be a name in C"),
    ('name = "tail"', 'name = "a b"', "message TWO, signal number 2: 'a b' cannot be a name in C"),
    ("start = 48", "start = 47", "message ONE, signal counter: e2e needs 'start' 48, 'length' 4, unsigned"),
    ('name = "crc", start = 56', 'name = "crk", start = 56', "message ONE: e2e needs a signal 'crc'"),
    ("number = 4", "number = 3", "fault cold: number 3 is already taken by fault hot"),
    ("number = 4", "number = 32", "fault cold: 'number' must be 0 to 31, found 32"),
    ("latched = false", "latched = 0", "fault cold: 'latched' must be true or false, found 0"),
    ("within_ms = 3", "within_ms = 0", "fault hot: 'within_ms' must be 1 to 60000, found 0"),
    ('["heat"]', '["a b"]', "fault hot, scenarios: 'a b' cannot be a name in C"),
    ("default = 5", "default = 10", "parameter gain: default 10 is outside -3 to 9"),
    ("default = 5", "default = 5.0", "parameter gain: 'default' must be an integer, found 5.0"),
    ("min = -3", "min = 10", "parameter gain: 'max' must be 10 to 2147483647, found 9"),
    ('meaning = "a gain"\n', "", "parameter gain: 'meaning' is missing"),
    ("[parameter.gain]", "[parameter.count]", "parameter count: the name is reserved"),
    ("on = 1, both = 2", "on = 1, both = 1", "enum mode, both: value 1 is already taken by enum mode, on"),
    ("on = 1, both = 2", "on = -1", "enum mode: value 'on' must be an integer from 0, found -1"),
    ("{ off = 0, on = 1, both = 2 }", "{}", "enum mode: has no values"),
    ("value = 7", "value = inf", "limit top: 'value' must be a finite number, found inf"),
    ("[limit.top]", "[limits.top]", "top level: unknown key 'limits'"),
    ("tick_hz = 1000", "tick_hz = 0", "[controller]: 'tick_hz' must be 1 to 1000000, found 0"),
    ("scale = 0.5", "scale = 1.0", "'scale' must be that of source 'u_hv', which travels as it is"),
    ("scale = 0.5", "scale = 0.75", "ONE, signal level: 'scale' 0.75 is not a whole multiple of 0.5 V, one of source"),
    ("scale = 0.5", "scale = 0.25", "ONE, signal level: 'scale' 0.25 is not a whole multiple of 0.5 V, one of source"),
    ("scale = 0.5", "scale = 0.5, offset = 3", "message ONE, signal level: unknown key 'offset'"),
    (', source = "u_hv"', "", "message ONE, signal level: 'scale' needs a 'source': the value in C"),
    ("u_hv", "u_kv", "signal level: 'source' u_kv: its suffix is not in [suffix] (known: hv,"),
    ("u_hv", "u hv", "message ONE, signal level, source: 'u hv' cannot be a name in C"),
    ('unit = "V", source', 'unit = "A", source', "signal level: 'unit' must be 'V', which source"),
    ("min = -100", "ceiling = true, min = -100", "level: 'ceiling' is for what the controller sends"),
    ("peak_mv", "volts_10mv", "THREE, signal peak: source 'volts_10mv' is already taken by"),
    ('hv = [0.5, "V"]', 'hv = [0.0, "V"]', "suffix hv: expected a positive number and its unit, as"),
    ("[promise.reach]", "[constant.reach]", "constant reach: unknown key 'test'"),
    ("tests/test_reach.py::test_reach", "a test", "promise reach: 'test' must be FILE::FUNCTION, found 'a test'"),
    ("[node]", "[nodde]", "top level: 'node' is missing"),
    ("version = 0", "version = ", "not TOML"),
    ("version = 0", "version = 256", "[controller]: 'version' must be 0 to 255, found 256"),
    ("version = 0", "version = -1", "[controller]: 'version' must be 0 to 255, found -1"),
    ('hv = [0.5, "V"]', 'hv = [1, "V"]', "suffix hv: expected a positive number and its unit, as"),
    ("id = 0x11", "id = 0x11\nlength = 9", "message TWO: 'length' must be 6 to 8, found 9"),
    ("cycle_ms = 5", "cycle_ms = 60001", "message ONE: 'cycle_ms' must be 0 to 60000, found 60001"),
    ("cycle_ms = 5", "cycle_ms = -1", "message ONE: 'cycle_ms' must be 0 to 60000, found -1"),
    ("start = 40", "start = -1", "message TWO, signal tail: 'start' must be 0 to 63, found -1"),
    ("start = 40", "start = 64", "message TWO, signal tail: 'start' must be 0 to 63, found 64"),
    ("start = 40", "start = 62", "signal tail: 'start' 62, 'length' 3: bits 62 to 64 exceed 8 bytes"),
    ("length = 3, min", 'length = 3, scale = 1.0, unit = "V", source = "tail_hv", min', "'scale' must be that of"),
    ("min = -3", "min = -2147483649", "parameter gain: 'min' must be -2147483648 to 2147483647, found -2147483649"),
    ("max = 9", "max = 2147483648", "parameter gain: 'max' must be -3 to 2147483647, found 2147483648"),
    ("[limit.top]", "[enum.fault]\nvalues = { hot = 1 }\n[limit.top]", "make the same name in C: TERRAPIN_FAULT_HOT"),
]  # fmt: skip


def big() -> str:
    """A good one with what neither the controller nor GOOD has: 257 different numbers among 96 parameters, some at the
    ends of 32 bits, limits that are no whole numbers, and messages of every length."""
    numbers = [-(2**31), -(2**30), -62, -31, -1, 0, 1, 2**31 - 1, *range(1000, 1249)]
    out = ['[controller]\nname = "big"\nversion = 255\ntick_hz = 1\n[node]\ncontroller = "A"\nhost = "B"\nthird = "C"']
    for index in range(96):
        low, default, high = sorted(numbers[(3 * index + k) % len(numbers)] for k in range(3))
        out.append(f'[parameter.p{index}]\ndefault = {default}\nmin = {low}\nmax = {high}\nmeaning = "m"')
        out.append('protects = "x"' if index % 3 == 1 else "")
    for name, value in (("half", 0.5), ("most", 2**31 - 1), ("more", 2**31), ("least", 1 - 2**31), ("low", -(2**31))):
        out.append(f'[limit.{name}]\nvalue = {value}\nmeaning = "m"')
    for length in range(1, 9):
        signals = [
            f'{{ name = "s{b}", start = {b}, length = {min(7, 8 * length - b)} }}' for b in range(0, 8 * length, 7)
        ]
        out.append(f'[message.M{length}]\nid = {length * 255}\nsender = "third"\nsignals = [ {", ".join(signals)} ]')
    out.append("[enum.edge]\nvalues = { low = 0, most = 2147483647 }\n[enum.two]\nvalues = { a = 0, b = 3 }")
    small = '{ name = "e", start = 0, length = 2, enum = "two" }, { name = "s", start = 2, length = 2, signed = true }'
    out.append(f'[message.SMALL]\nid = 2\nsender = "host"\ncycle_ms = 60000\nsignals = [ {small} ]')
    wide = (
        '{ name = "a", start = 0, length = 31, signed = true }, { name = "f", start = 31, length = 1 }, '
        '{ name = "b", start = 32, length = 32, signed = true }'
    )
    out.append(f'[message.WIDE]\nid = 0\nsender = "host"\ncomment = "a \\"b\\""\nsignals = [ {wide} ]')
    narrow = "".join(
        f'{{ name = "n{i}", start = {8 * i}, length = 6, signed = true, min = {low}, max = {high} }}, '
        for i, (low, high) in enumerate([(0, 31), (-16, 15), (-1, 30), (-31, 0), (-32, -1), (1, 1), (-32, 16), (-2, 7)])
    )
    out.append(f'[message.NARROW]\nid = 1\nsender = "host"\nsignals = [ {narrow} ]')
    return "\n".join(out) + "\n"
