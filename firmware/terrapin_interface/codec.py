"""The C face of the description: terrapin_interface.h and .c, terrapin_pack.h.

Packing and unpacking are straight shifts into the two halves of a frame, and stand once: as inline functions in
terrapin_pack.h. Where a message is made and packed in one place, its struct never reaches memory. The functions of
terrapin_interface.h are the same, to be called.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from terrapin_interface.entries import INT32_MAX, Block, Description, DescriptionError, Message, Signal

__all__ = ["NOTICE", "c_kind", "header", "pack_header", "source"]

NOTICE = "Generated from controller.toml by firmware/terrapin_interface/generate.py; not to be edited."


def header(d: Description) -> str:
    """Text of terrapin_interface.h. DescriptionError when two names of the description make one name in C."""
    constants = [*_enums(d), *_faults(d), *_parameters(d), *_limits(d), *_nodes(d), *_messages(d)]
    _check_unique(constants)
    out = [
        f"/* {NOTICE} */",
        "#ifndef TERRAPIN_INTERFACE_H",
        "#define TERRAPIN_INTERFACE_H",
        "",
        '#include "terrapin.h"',
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        f"#define TERRAPIN_INTERFACE_VERSION {d.version}",
        *(line for block in constants for line in block),
        "/* One entry a parameter, in file order. Raw integers. */",
        "typedef struct {",
        "    int32_t default_value;",
        "    int32_t minimum;",
        "    int32_t maximum;",
        "} terrapin_parameter_entry;",
    ]
    if d.parameters:
        out.append("/* index is below TERRAPIN_PARAMETER_COUNT. */")
        out.append("TERRAPIN_API terrapin_parameter_entry terrapin_parameter(uint16_t index);")
        out.append("/* All of them at once, in file order; quicker than one by one. */")
        out.append("TERRAPIN_API void terrapin_parameter_defaults(int32_t values[TERRAPIN_PARAMETER_COUNT]);")
        out.append("TERRAPIN_API bool terrapin_parameters_in_range(const int32_t values[TERRAPIN_PARAMETER_COUNT]);")
        out.append("/* What a stored value is known by: FNV-1a of name, unit and scale. */")
        out.append("TERRAPIN_API extern const uint32_t terrapin_parameter_hashes[TERRAPIN_PARAMETER_COUNT];")
        out.append(
            "/* True when a wrong value endangers something (`protects`). index is below TERRAPIN_PARAMETER_COUNT. */"
        )
        out.append("TERRAPIN_API bool terrapin_parameter_protected(uint16_t index);")
    out += ["", _E2E_HEADER]
    for message in d.messages:
        out += _struct(d, message)
    return "\n".join([*out, "#ifdef __cplusplus", "}", "#endif", "#endif", ""])


def source(d: Description) -> str:
    """Text of terrapin_interface.c."""
    out = [f"/* {NOTICE} */", '#include "terrapin_pack.h"', ""]
    if d.parameters:
        out += [*_table(d), "", *_protected(d), ""]
        out.append("const uint32_t terrapin_parameter_hashes[TERRAPIN_PARAMETER_COUNT] = {")
        out += [f"    0x{p.hash:08X}U, /* {p.name} */" for p in d.parameters]
        out += ["};", ""]
    out.append(_HELPERS)
    for message in d.messages:
        out += [*_callables(message), ""]
    return "\n".join(out)


def pack_header(d: Description) -> str:
    """Text of terrapin_pack.h."""
    out = [f"/* {NOTICE} */", "#ifndef TERRAPIN_PACK_H", "#define TERRAPIN_PACK_H", ""]
    out += ['#include "terrapin_interface.h"', "", _PACK_HELPERS]
    for message in d.messages:
        out += [*_packer(message), "", *_unpacker(message), ""]
    return "\n".join([*out, "#endif", ""])


def _table(d: Description) -> list[str]:
    """Each number once, and three bytes a parameter that say which: many share theirs, and a word is four bytes."""
    numbers = sorted({value for p in d.parameters for value in (p.default, p.minimum, p.maximum)})
    place = {value: i for i, value in enumerate(numbers)}
    kind = "uint8_t" if len(numbers) <= 256 else "uint16_t"
    return [
        f"static const int32_t parameter_number[{len(numbers)}] = {{",
        *(f"    {_c(value)}," for value in numbers),
        "};",
        f"static const {kind} parameter_place[{-(-3 * len(d.parameters) // 4) * 4}] = {{",
        *(f"    {place[p.default]}U, {place[p.minimum]}U, {place[p.maximum]}U, /* {p.name} */" for p in d.parameters),
        "};",
        "",
        "terrapin_parameter_entry terrapin_parameter(uint16_t index) {",
        f"    const {kind} *own = &parameter_place[3U * (uint32_t)index];",
        "    const terrapin_parameter_entry entry = {",
        "        .default_value = parameter_number[own[0]],",
        "        .minimum = parameter_number[own[1]],",
        "        .maximum = parameter_number[own[2]],",
        "    };",
        "    return entry;",
        "}",
        "",
        "void terrapin_parameter_defaults(int32_t values[TERRAPIN_PARAMETER_COUNT]) {",
        "    for (uint32_t i = 0U; i < (uint32_t)TERRAPIN_PARAMETER_COUNT; i++) {",
        "        values[i] = parameter_number[parameter_place[3U * i]];",
        "    }",
        "}",
        "",
        "bool terrapin_parameters_in_range(const int32_t values[TERRAPIN_PARAMETER_COUNT]) {",
        "    bool good = true;",
        "    for (uint32_t i = 0U; i < (uint32_t)TERRAPIN_PARAMETER_COUNT; i++) {",
        f"        const {kind} *own = &parameter_place[3U * i];",
        "        good = good && (values[i] >= parameter_number[own[1]]) && (values[i] <= parameter_number[own[2]]);",
        "    }",
        "    return good;",
        "}",
    ]


def _protected(d: Description) -> list[str]:
    words = [0] * ((len(d.parameters) + 31) // 32)
    for p in d.parameters:
        words[p.index // 32] |= bool(p.protects) << (p.index % 32)
    return [
        "bool terrapin_parameter_protected(uint16_t index) {",
        f"    static const uint32_t bits[{len(words)}] = {{{', '.join(f'0x{word:08X}U' for word in words)}}};",
        "    return ((bits[index / 32U] >> (index % 32U)) & 1U) != 0U;",
        "}",
    ]


def _c(value: int) -> str:
    """A 32-bit constant; the most negative one cannot be written as one literal."""
    return "(-2147483647 - 1)" if value == -(2**31) else str(value)


def _check_unique(blocks: Iterable[list[str]]) -> None:
    seen: set[str] = set()
    for line in (line.strip() for block in blocks for line in block):
        words = line.removeprefix("#define ").split()
        if words and words[0].startswith("TERRAPIN_"):
            if words[0] in seen:
                raise DescriptionError(f"two names of the description make the same name in C: {words[0]}")
            seen.add(words[0])


def _enums(d: Description) -> Iterator[list[str]]:
    for name, values in d.enums.items():
        entries = [f"#define TERRAPIN_{name.upper()}_{key.upper()} {value}" for key, value in values.items()]
        yield [f"/* {name} */", *entries, ""]


def _faults(d: Description) -> Iterator[list[str]]:
    latched = sum(1 << f.number for f in d.faults if f.latched)
    known = sum(1 << f.number for f in d.faults)
    yield [
        "/* Faults: bit numbers of terrapin_outputs.faults. */",
        *(f"#define TERRAPIN_FAULT_{f.name.upper()} {f.number}" for f in d.faults),
        f"#define TERRAPIN_FAULTS_KNOWN 0x{known:08X}U",
        f"#define TERRAPIN_FAULTS_LATCHED 0x{latched:08X}U",
        "",
    ]


def _parameters(d: Description) -> Iterator[list[str]]:
    yield [
        "/* Parameters: indices of terrapin_parameter_set and of PARAMETER_WRITE. */",
        *(f"#define TERRAPIN_PARAMETER_{p.name.upper()} {p.index}" for p in d.parameters),
        f"#define TERRAPIN_PARAMETER_COUNT {len(d.parameters)}",
        "",
    ]


def _limits(d: Description) -> Iterator[list[str]]:
    """Whole numbers alone: the firmware knows no fractions."""
    kinds = (("Limits", "LIMIT_", d.limits), ("Constants", "", d.constants), ("Promises", "PROMISE_", d.promises))
    for title, prefix, entries in kinds:
        whole = [x for x in entries if x.value.is_integer() and abs(x.value) <= INT32_MAX]
        yield [
            f"/* {title}, in the units of controller.toml. */",
            *(f"#define TERRAPIN_{prefix}{x.name.upper()} {_c(int(x.value))}" for x in whole),
            "",
        ]


def _messages(d: Description) -> Iterator[list[str]]:
    yield [
        *(f"#define TERRAPIN_ID_{m.name.upper()} 0x{m.id:03X}U" for m in d.messages),
        *(f"#define TERRAPIN_LENGTH_{m.name.upper()} {m.length}U" for m in d.messages),
        "",
    ]


def _nodes(d: Description) -> Iterator[list[str]]:
    """The plan of identifiers, for link/node.c."""
    if d.blocks:
        blocks = sorted(d.blocks, key=lambda block: block.sender == "controller")  # first what a controller receives
        rows = [
            f"{{0x{b.first:03X}U, 0x{b.node_1:03X}U, 0x{b.step:03X}U, {b.size}U, {_protected_bits(d, b)}}}"
            for b in blocks
        ]
        yield [
            "/* Controllers on one bus, and their blocks of identifiers: rows of terrapin_block (link/node.h). */",
            f"#define TERRAPIN_NODES {d.node_count}U",
            *(f"#define TERRAPIN_BLOCK_{b.name.upper()} {i}U" for i, b in enumerate(blocks)),
            f"#define TERRAPIN_BLOCK_RECEIVED {sum(b.sender != 'controller' for b in blocks)}U",
            f"#define TERRAPIN_BLOCK_COUNT {len(d.blocks)}U",
            f"#define TERRAPIN_BLOCKS {{{', '.join(rows)}}}",
            *_authorities(d),
            "",
        ]


def _authorities(d: Description) -> list[str]:
    """What each identifier of the block `updates` must have before it changes anything; of one without message: 0."""
    named = {m.id: d.enums["authority"][m.authority] for m in d.messages if m.authority}
    return [
        f"#define TERRAPIN_{b.name.upper()}_AUTHORITY "
        f"{{{', '.join(f'{named.get(b.first + i, 0)}U' for i in range(b.size))}}} /* enum authority, by identifier */"
        for b in d.blocks
        if b.name == "updates"
    ]


def _protected_bits(d: Description, block: Block) -> str:
    """A bit for each identifier of a block whose message is protected, in two words."""
    own = range(block.first, block.first + block.size)
    bits = sum(1 << own.index(m.id) for m in d.messages if m.e2e and m.id in own)
    return f"{{0x{bits & 0xFFFFFFFF:08X}U, 0x{bits >> 32:08X}U}}"


def c_kind(signal: Signal) -> str:
    """Fields are wider than their bits, so that a value out of range arrives at the encoder and is clamped there."""
    return "uint32_t" if signal.highest > INT32_MAX else "int32_t"


def _struct(d: Description, message: Message) -> list[str]:
    name = message.name.lower()
    lines = [
        f"/* {message.name} (0x{message.id:03X}), {message.length} bytes, from {d.nodes[message.sender]}. */",
        "typedef struct {",
    ]
    for s in message.signals:
        unit = f", {s.scale:g} {s.unit}" if s.unit else ""
        values = f", enum {s.enum}" if s.enum else ""
        lines.append(f"    {c_kind(s)} {s.name}; /* {s.minimum} to {s.maximum}{unit}{values} */")
    return [
        *lines,
        f"}} terrapin_{name}_t;",
        f"TERRAPIN_API bool terrapin_encode_{name}(const terrapin_{name}_t *message, terrapin_frame *frame);",
        f"TERRAPIN_API bool terrapin_decode_{name}(const terrapin_frame *frame, terrapin_{name}_t *message);",
        "",
    ]


_E2E_HEADER = """\
/* End-to-end protection, after AUTOSAR E2E profile 1: a 4-bit counter that runs 0 to 14 (low bits of byte 6) and the
 * CRC-8 of SAE J1850 (polynomial 0x1D, start 0xFF, final XOR 0xFF; "123456789" gives 0x4B) in byte 7, over the data id
 * (the CAN id, low byte first) and bytes 0 to 6. Lost frames are tolerated, repeated ones are not. */
#define TERRAPIN_E2E_COUNTER_MAX 14U
#define TERRAPIN_E2E_NO_COUNTER  0xFFU /* last counter of a receiver that has seen no frame yet: any counter is good */

typedef enum {
    TERRAPIN_E2E_OK = 0,
    TERRAPIN_E2E_BAD_CRC = 1, /* CRC, length, or a counter above 14 */
    TERRAPIN_E2E_REPEATED = 2 /* intact, but its counter is that of the last accepted frame */
} terrapin_e2e_result;

/* CRC-8 SAE J1850 of length bytes, continued from crc (0 to begin). */
TERRAPIN_API uint8_t terrapin_crc8(uint8_t crc, const uint8_t *bytes, size_t length);
/* Write counter (0 to 14; taken modulo 15) and CRC into an encoded frame of 8 bytes. */
TERRAPIN_API void terrapin_e2e_protect(terrapin_frame *frame, uint32_t counter);
/* Check a frame; *last_counter is set when the answer is TERRAPIN_E2E_OK and left alone otherwise. */
TERRAPIN_API terrapin_e2e_result terrapin_e2e_check(const terrapin_frame *frame, uint8_t *last_counter);

/* Messages. terrapin_encode_... clamps each field to its range, never wraps, and returns false when it had to.
 * terrapin_decode_... returns false, and leaves *message alone, when the frame has another id or length. */
"""

_HELPERS = """\
uint8_t terrapin_crc8(uint8_t crc, const uint8_t *bytes, size_t length) {
    /* Half a byte at a time: 16 bytes of table, twice as quick as bit by bit. */
    static const uint8_t table[16] = {0x00U, 0x1DU, 0x3AU, 0x27U, 0x74U, 0x69U, 0x4EU, 0x53U,
                                      0xE8U, 0xF5U, 0xD2U, 0xCFU, 0x9CU, 0x81U, 0xA6U, 0xBBU};
    uint32_t c = (uint32_t)crc ^ 0xFFU;
    for (size_t i = 0; i < length; i++) {
        c ^= bytes[i];
        c = ((c << 4U) & 0xFFU) ^ table[c >> 4U];
        c = ((c << 4U) & 0xFFU) ^ table[c >> 4U];
    }
    c ^= 0xFFU;
    return (uint8_t)c;
}

/* Words of a frame as the CRC takes them: first byte first. */
static uint32_t big_word(const uint8_t *bytes) {
    return ((uint32_t)bytes[0] << 24U) | ((uint32_t)bytes[1] << 16U) | ((uint32_t)bytes[2] << 8U) | bytes[3];
}

/* terrapin_crc8 of the data id and bytes 0 to 6, a word at a time: modulo P = x^8 + x^4 + x^3 + x^2 + 1 the powers
 * x^25, x^50 and x^14 are x + 1, x^2 + 1 and x^4 + x + 1: a few shifts bring down what stands above them. */
static uint8_t frame_crc(const terrapin_frame *frame) {
    const uint32_t id = (((uint32_t)frame->id & 0xFFU) << 8U) | ((uint32_t)frame->id >> 8U);
    const uint32_t begin = id ^ 0xFF00U;
    const uint32_t first = big_word(frame->data);
    uint32_t c = big_word(&frame->data[4]) & 0xFFFFFF00U;
    c ^= (begin << 16U) ^ (begin << 14U); /* begin x^64, as x^14 x^50 */
    const uint32_t folded = first ^ (first >> 24U) ^ (first >> 25U);
    c ^= (folded << 8U) ^ (folded << 7U); /* first x^32, as x^7 x^25, and what that pushes out at the top */
    for (uint32_t i = 0U; i < 2U; i++) { /* 32 bits to 22, to 14 */
        const uint32_t above = c >> 14U;
        c = (c & 0x3FFFU) ^ above ^ (above << 1U) ^ (above << 4U);
    }
    for (uint32_t i = 0U; i < 2U; i++) { /* to 10, to 8 */
        const uint32_t above = c >> 8U;
        c = (c & 0xFFU) ^ above ^ (above << 2U) ^ (above << 3U) ^ (above << 4U);
    }
    return (uint8_t)(c ^ 0xFFU);
}

void terrapin_e2e_protect(terrapin_frame *frame, uint32_t counter) {
    const uint32_t byte = ((uint32_t)frame->data[6] & 0xF0U) | (counter % (TERRAPIN_E2E_COUNTER_MAX + 1U));
    frame->data[6] = (uint8_t)byte;
    frame->data[7] = frame_crc(frame);
}

terrapin_e2e_result terrapin_e2e_check(const terrapin_frame *frame, uint8_t *last_counter) {
    const uint8_t counter = frame->data[6] & 0x0FU;
    terrapin_e2e_result result = TERRAPIN_E2E_OK;
    if ((frame->length != 8U) || (frame->data[7] != frame_crc(frame)) || (counter > TERRAPIN_E2E_COUNTER_MAX)) {
        result = TERRAPIN_E2E_BAD_CRC;
    } else if (counter == *last_counter) {
        result = TERRAPIN_E2E_REPEATED;
    } else {
        *last_counter = counter;
    }
    return result;
}
"""


_PACK_HELPERS = """\
/* terrapin_pack_... and terrapin_unpack_... are terrapin_encode_... and terrapin_decode_..., to be compiled where they
 * are used; terrapin_read_... is for who has looked at identifier and length. */

/* value within low..high, as bits; *lost is not 0 any more when it was outside. */
static inline uint32_t terrapin_hold(int32_t value, int32_t low, int32_t high, uint32_t *lost) {
    const int32_t raised = (value < low) ? low : value;
    const int32_t held = (raised > high) ? high : raised;
    *lost |= (uint32_t)held ^ (uint32_t)value;
    return (uint32_t)held;
}

static inline uint32_t terrapin_hold_unsigned(uint32_t value, uint32_t low, uint32_t high, uint32_t *lost) {
    const uint32_t raised = (value < low) ? low : value;
    const uint32_t held = (raised > high) ? high : raised;
    *lost |= held ^ value;
    return held;
}

/* Low byte first. */
static inline void terrapin_put_word(uint8_t *bytes, uint32_t word) {
#if defined(__ARM_FEATURE_UNALIGNED) && (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__)
    __builtin_memcpy(bytes, &word, sizeof word); /* one store, wherever */
#else
    bytes[0] = (uint8_t)word;
    bytes[1] = (uint8_t)(word >> 8U);
    bytes[2] = (uint8_t)(word >> 16U);
    bytes[3] = (uint8_t)(word >> 24U);
#endif
}

static inline uint32_t terrapin_get_word(const uint8_t *bytes) {
#if defined(__ARM_FEATURE_UNALIGNED) && (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__)
    uint32_t word;
    __builtin_memcpy(&word, bytes, sizeof word); /* one load, wherever */
    return word;
#else
    return bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[3] << 24U);
#endif
}

/* The number whose bits these are; half is the value of its top bit. */
static inline int32_t terrapin_signed(uint32_t bits, uint32_t half) {
    const uint32_t extended = (bits ^ half) - half;
    return (int32_t)extended;
}

static inline void terrapin_fill(terrapin_frame *frame, uint16_t id, uint8_t length, uint32_t low, uint32_t high) {
    frame->id = id;
    frame->length = length;
    terrapin_put_word(frame->data, low);
    terrapin_put_word(&frame->data[4], high);
}
"""


def _packer(message: Message) -> list[str]:
    """Straight shifts into the two halves of a frame; each field held within its range."""
    name = message.name.lower()
    lines = [
        f"static inline bool terrapin_pack_{name}(const terrapin_{name}_t *message, terrapin_frame *frame) {{",
        "    uint32_t low = 0U;",
        "    uint32_t high = 0U;",
        "    uint32_t lost = 0U;",
        "    uint32_t bits;",
    ]
    for s in message.signals:
        field = f"message->{s.name}"
        if c_kind(s) == "uint32_t":
            held = f"terrapin_hold_unsigned({field}, {s.minimum}U, {s.maximum}U, &lost)"
        else:
            held = f"terrapin_hold({field}, {_c(s.minimum)}, {_c(s.maximum)}, &lost)"
        mask = f" & 0x{(1 << s.length) - 1:X}U" if s.minimum < 0 and s.length < 32 else ""
        lines.append(f"    bits = {held}{mask};")
        if s.start < 32:
            lines.append(f"    low |= bits << {s.start}U;" if s.start else "    low |= bits;")
            if s.start + s.length > 32:
                lines.append(f"    high |= bits >> {32 - s.start}U;")
        else:
            lines.append(f"    high |= bits << {s.start - 32}U;" if s.start > 32 else "    high |= bits;")
    upper = message.name.upper()
    return [
        *lines,
        f"    terrapin_fill(frame, TERRAPIN_ID_{upper}, TERRAPIN_LENGTH_{upper}, low, high);",
        "    return lost == 0U;",
        "}",
    ]


def _unpacker(message: Message) -> list[str]:
    """Straight shifts out of the two halves of a frame, and the same where the frame is one of this message."""
    name, upper = message.name.lower(), message.name.upper()
    lines = [
        f"static inline void terrapin_read_{name}(const terrapin_frame *frame, terrapin_{name}_t *message) {{",
    ]
    halves = [half for half, used in zip(("low", "high"), _halves(message), strict=True) if used]
    for half in halves:
        place = "frame->data" if half == "low" else "&frame->data[4]"
        lines.append(f"    const uint32_t {half} = terrapin_get_word({place});")
    for s in message.signals:
        bits = _bits(s)
        if s.length < 32:
            bits = f"{bits} & 0x{(1 << s.length) - 1:X}U"
        if c_kind(s) == "uint32_t":
            lines.append(f"    message->{s.name} = {bits};")
        else:
            half = f"0x{1 << (s.length - 1):X}U" if s.signed else "0U"
            lines.append(f"    message->{s.name} = terrapin_signed({bits}, {half});")
    return [
        *lines,
        "}",
        "",
        f"static inline bool terrapin_unpack_{name}(const terrapin_frame *frame, terrapin_{name}_t *message) {{",
        f"    const bool ours = (frame->id == TERRAPIN_ID_{upper}) && (frame->length == TERRAPIN_LENGTH_{upper});",
        "    if (ours) {",
        f"        terrapin_read_{name}(frame, message);",
        "    }",
        "    return ours;",
        "}",
    ]


def _halves(message: Message) -> tuple[bool, bool]:
    """Whether a signal has bits in the low half, and in the high one."""
    return any(s.start < 32 for s in message.signals), any(s.start + s.length > 32 for s in message.signals)


def _bits(s: Signal) -> str:
    """An expression whose low bits are the signal's."""
    if s.start >= 32:
        return f"(high >> {s.start - 32}U)" if s.start > 32 else "high"
    low = f"(low >> {s.start}U)" if s.start else "low"
    return f"({low} | (high << {32 - s.start}U))" if s.start + s.length > 32 else low


def _callables(message: Message) -> list[str]:
    """The same as functions."""
    name = message.name.lower()
    return [
        f"bool terrapin_encode_{name}(const terrapin_{name}_t *message, terrapin_frame *frame) {{",
        f"    return terrapin_pack_{name}(message, frame);",
        "}",
        "",
        f"bool terrapin_decode_{name}(const terrapin_frame *frame, terrapin_{name}_t *message) {{",
        f"    return terrapin_unpack_{name}(frame, message);",
        "}",
    ]
