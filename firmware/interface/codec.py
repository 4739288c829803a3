"""The C face of the description: terrapin_interface.h and .c.

The encoders are straight-line shifts into two 32-bit words. Clamping is written so that a compiler for ARM turns it
into SSAT or USAT and the flag costs two instructions a signal: small and quick at once, which a table walked at run
time is not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from firmware.interface.description import INT32_MAX, Description, DescriptionError, Message, Signal

__all__ = ["NOTICE", "header", "source"]

NOTICE = "Generated from controller.toml by firmware/interface/generate.py; not to be edited."


def header(d: Description) -> str:
    """Text of terrapin_interface.h. DescriptionError when two names of the description make one name in C."""
    constants = [*_enums(d), *_faults(d), *_parameters(d), *_limits(d), *_messages(d)]
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
        "/* One entry a parameter, in file order. Raw integers; flags: TERRAPIN_PARAMETER_PROTECTED. */",
        "#define TERRAPIN_PARAMETER_PROTECTED 1",
        "typedef struct {",
        "    int32_t default_value;",
        "    int32_t minimum;",
        "    int32_t maximum;",
        "    uint32_t flags;",
        "} terrapin_parameter_entry;",
    ]
    if d.parameters:
        out.append("TERRAPIN_API extern const terrapin_parameter_entry terrapin_parameters[TERRAPIN_PARAMETER_COUNT];")
    out += ["", _E2E_HEADER]
    for message in d.messages:
        out += _struct(d, message)
    return "\n".join([*out, "#ifdef __cplusplus", "}", "#endif", "#endif", ""])


def source(d: Description) -> str:
    """Text of terrapin_interface.c."""
    out = [f"/* {NOTICE} */", '#include "terrapin_interface.h"', ""]
    if d.parameters:
        out.append("const terrapin_parameter_entry terrapin_parameters[TERRAPIN_PARAMETER_COUNT] = {")
        for p in d.parameters:
            flags = "TERRAPIN_PARAMETER_PROTECTED" if p.protects else "0"
            out.append(f"    {{{_c(p.default)}, {_c(p.minimum)}, {_c(p.maximum)}, {flags}}}, /* {p.index} {p.name} */")
        out += ["};", ""]
    messages = [line for m in d.messages for line in (*_encoder(m), "", *_decoder(m), "")]
    used = [text for name, text in _OPTIONAL_HELPERS.items() if any(f" {name}(" in line for line in messages)]
    return "\n".join([*out, *used, _HELPERS, *messages])


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
    whole = [x for x in d.limits if x.value.is_integer() and abs(x.value) <= INT32_MAX]
    yield [
        "/* Limits, in the units of controller.toml. */",
        *(f"#define TERRAPIN_LIMIT_{x.name.upper()} {_c(int(x.value))}" for x in whole),
        "",
    ]


def _messages(d: Description) -> Iterator[list[str]]:
    yield [
        *(f"#define TERRAPIN_ID_{m.name.upper()} 0x{m.id:03X}U" for m in d.messages),
        *(f"#define TERRAPIN_LENGTH_{m.name.upper()} {m.length}U" for m in d.messages),
        "",
    ]


def _kind(signal: Signal) -> str:
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
        lines.append(f"    {_kind(s)} {s.name}; /* {s.minimum} to {s.maximum}{unit}{values} */")
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

# Written only when some message needs them: a compiler may refuse an unused function.
_OPTIONAL_HELPERS = {
    "fit": """\
static inline uint32_t fit(int32_t value, int32_t minimum, int32_t maximum, uint32_t *lost) {
    int32_t fitted = value;
    if (fitted < minimum) {
        fitted = minimum;
    }
    if (fitted > maximum) {
        fitted = maximum;
    }
    *lost |= (uint32_t)fitted ^ (uint32_t)value;
    return (uint32_t)fitted;
}
""",
    "fit_unsigned": """\
static inline uint32_t fit_unsigned(uint32_t value, uint32_t minimum, uint32_t maximum, uint32_t *lost) {
    uint32_t fitted = value;
    if (fitted < minimum) {
        fitted = minimum;
    }
    if (fitted > maximum) {
        fitted = maximum;
    }
    *lost |= fitted ^ value;
    return fitted;
}
""",
    "extend": """\
/* Two's complement of fewer than 32 bits; sign is the value of the top bit. */
static inline int32_t extend(uint32_t raw, uint32_t sign) {
    const uint32_t flipped = raw ^ sign;
    return (int32_t)flipped - (int32_t)sign;
}
""",
}

_HELPERS = """\
static void store(uint8_t *bytes, uint32_t word) {
    bytes[0] = (uint8_t)(word & 0xFFU);
    bytes[1] = (uint8_t)((word >> 8U) & 0xFFU);
    bytes[2] = (uint8_t)((word >> 16U) & 0xFFU);
    bytes[3] = (uint8_t)(word >> 24U);
}

static uint32_t fetch(const uint8_t *bytes) {
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U) | ((uint32_t)bytes[3] << 24U);
}

static void finish(terrapin_frame *frame, uint16_t id, uint8_t length, uint32_t low, uint32_t high) {
    frame->id = id;
    frame->length = length;
    store(&frame->data[0], low);
    store(&frame->data[4], high);
}

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

static uint8_t frame_crc(const terrapin_frame *frame) {
    const uint8_t data_id[2] = {(uint8_t)(frame->id & 0xFFU), (uint8_t)(frame->id >> 8U)};
    return terrapin_crc8(terrapin_crc8(0U, data_id, 2U), frame->data, 7U);
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


def _place(signal: Signal, field: str) -> list[str]:
    """Statements that or `field`, already masked to its bits, into low and high."""
    start, end = signal.start, signal.start + signal.length
    if start >= 32:
        return [f"    high |= {field} << {start - 32}U;" if start > 32 else f"    high |= {field};"]
    lines = [f"    low |= {field} << {start}U;" if start else f"    low |= {field};"]
    if end > 32:
        lines.append(f"    high |= {field} >> {32 - start}U;")
    return lines


def _encoder(message: Message) -> list[str]:
    name = message.name.lower()
    body: list[str] = []
    fits = False
    for s in message.signals:
        value = f"message->{s.name}"
        if _kind(s) == "uint32_t":
            if (s.minimum, s.maximum) != (s.lowest, s.highest):
                value, fits = f"fit_unsigned({value}, {s.minimum}U, {s.maximum}U, &lost)", True
        elif s.length == 32 and (s.minimum, s.maximum) == (s.lowest, s.highest):
            value = f"(uint32_t){value}"
        else:
            value, fits = f"fit({value}, {_c(s.minimum)}, {_c(s.maximum)}, &lost)", True
            if s.signed and s.length < 32:
                value = f"{value} & 0x{2**s.length - 1:X}U"
        body += [f"    field = {value};", *_place(s, "field")]
    used_low = any(s.start < 32 for s in message.signals)
    used_high = any(s.start + s.length > 32 for s in message.signals)
    lines = [f"bool terrapin_encode_{name}(const terrapin_{name}_t *message, terrapin_frame *frame) {{"]
    if fits:
        lines.append("    uint32_t lost = 0U; /* a bit is set when a value did not fit */")
    lines += ["    uint32_t field;"]
    lines += ["    uint32_t low = 0U;"] if used_low else []
    lines += ["    uint32_t high = 0U;"] if used_high else []
    words = f"{'low' if used_low else '0U'}, {'high' if used_high else '0U'}"
    identity = f"(uint16_t)TERRAPIN_ID_{message.name.upper()}, (uint8_t)TERRAPIN_LENGTH_{message.name.upper()}"
    result = "lost == 0U" if fits else "true"
    return [*lines, *body, f"    finish(frame, {identity}, {words});", f"    return {result};", "}"]


def _extract(signal: Signal) -> str:
    """Expression of the raw bits, from low and high."""
    start, end, mask = signal.start, signal.start + signal.length, f"0x{2**signal.length - 1:X}U"
    if start >= 32:
        text = f"(high >> {start - 32}U)" if start > 32 else "high"
        return text if end == 64 else f"({text} & {mask})"
    text = f"(low >> {start}U)" if start else "low"
    if end == 32:
        return text
    if end < 32:
        return f"({text} & {mask})"
    return f"(({text} | (high << {32 - start}U)) & {mask})"


def _decoder(message: Message) -> list[str]:
    name, upper = message.name.lower(), message.name.upper()
    body: list[str] = []
    for s in message.signals:
        value = _extract(s)
        if s.signed and s.length < 32:
            value = f"extend({value}, 0x{2 ** (s.length - 1):X}U)"
        elif _kind(s) == "int32_t":
            body.append(f"        field = {value};")
            value = "(int32_t)field"
        body.append(f"        message->{s.name} = {value};")
    words = []
    if any(s.start < 32 for s in message.signals):
        words.append("        const uint32_t low = fetch(&frame->data[0]);")
    if any(s.start + s.length > 32 for s in message.signals):
        words.append("        const uint32_t high = fetch(&frame->data[4]);")
    if any("field" in line for line in body):
        words.append("        uint32_t field;")
    return [
        f"bool terrapin_decode_{name}(const terrapin_frame *frame, terrapin_{name}_t *message) {{",
        f"    const bool ours = (frame->id == TERRAPIN_ID_{upper}) && (frame->length == TERRAPIN_LENGTH_{upper});",
        "    if (ours) {",
        *words,
        *body,
        "    }",
        "    return ours;",
        "}",
    ]
