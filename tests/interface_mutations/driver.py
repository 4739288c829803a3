"""The C that drives what was generated: written from the second reading of the description and from state.h.

CORE is where the core keeps what each signal carries, and what one of it is: nothing of it comes from `source` and
[suffix] of controller.toml, which are what is tested. PORT has the same for what a port fills.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

from tests.interface_mutations.reference import Message, Reference, Signal

__all__ = ["CORE", "PORT", "RANGES", "SLOTS", "driver"]

SLOTS = ("STATUS", "GROUND", "MOTION", "ELECTRICAL", "WINDOW", "FIT", "REPORT", "CALIBRATION", "ATTITUDE", "HEADING")
RANGES = {
    "bool": (0, 1), "uint8_t": (0, 255), "int16_t": (-32768, 32767), "uint16_t": (0, 65535),
    "int32_t": (-(2**31), 2**31 - 1), "uint32_t": (0, 2**32 - 1), "held": (-(2**30) + 1, 2**30 - 1),
}  # fmt: skip
_PLACES = """
ACTUATE.duty drive.duty_q15 int16_t 1/32768
ACTUATE.tick inputs.tick uint16_t 1
ACTUATE.state supervisor.state int32_t 1
ACTUATE.enable drive.enable bool 1
ACTUATE.limiting drive.limiting bool 1
ACTUATE.current_limiting drive.current_limiting bool 1
ACTUATE.ground_valid estimator.valid bool 1
STATUS.faults supervisor.faults uint32_t 1
STATUS.state supervisor.state int32_t 1
STATUS.report supervisor.report int32_t 1
STATUS.calibrated parameter[TERRAPIN_PARAMETER_CALIBRATED] bool 1
STATUS.trimmed sense.trimmed bool 1
STATUS.limiter_slow slip.slow bool 1
STATUS.saturated saturated_shown bool 1
STATUS.ready ready bool 1
STATUS.tick inputs.tick uint16_t 1
GROUND.torque estimator.torque_unm int32_t 1/1000000
GROUND.torque_sd estimator.sd_unm int32_t 1/1000000
GROUND.f_r ground.f_r_ppm int32_t 1/1000000
GROUND.valid estimator.valid bool 1
GROUND.saturated estimator.saturated bool 1
GROUND.terrain ground.terrain int32_t 1
GROUND.margin ground.margin_q3 int32_t 1/8
GROUND.limiting drive.limiting bool 1
MOTION.slip slip.slip_e4 int32_t 1/10000
MOTION.slip_valid slip.valid bool 1
MOTION.slow slip.slow bool 1
MOTION.external slip.external bool 1
MOTION.shell_speed slip.shell_urad_s int32_t 1/1000000
MOTION.motor_speed slip.wheel_urad_s held 1/1000000
MOTION.ground_speed slip.ground_um_s int32_t 1/1000000
ELECTRICAL.current estimator.recent_ua int32_t 1/1000000
ELECTRICAL.supply supply int32_t 1/1000
ELECTRICAL.temperature temperature int32_t 1/1000
ELECTRICAL.voltage drive.applied_mv int32_t 1/1000
ELECTRICAL.current_limiting drive.current_limiting bool 1
ELECTRICAL.enable drive.enable bool 1
WINDOW.current estimator.current_10ua int32_t 1/100000
WINDOW.omega estimator.omega_urad_s int32_t 1/1000000
WINDOW.voltage estimator.voltage_mv int32_t 1/1000
WINDOW.valid estimator.valid bool 1
WINDOW.index estimator.index uint8_t 1
WINDOW.fresh estimator.fresh bool 1
FIT.f_o ground.f_o_10ppm int32_t 1/100000
FIT.f_o_sd ground.f_o_sd_ppm int32_t 1/1000000
FIT.f_s ground.f_s_e7 int32_t 1/10000000
FIT.f_s_sd ground.f_s_sd_e7 int32_t 1/10000000
FIT.windows ground.windows uint8_t 1
REPORT.report supervisor.report int32_t 1
REPORT.number supervisor.report_number uint8_t 1
REPORT.distance supervisor.report_distance_mm int32_t 1/1000
REPORT.duration supervisor.report_duration_10ms int32_t 1/100
REPORT.slip_peak slip.peak_e4 int32_t 1/10000
CALIBRATION.coulomb parameter[TERRAPIN_PARAMETER_COULOMB] int32_t 1/1000000
CALIBRATION.viscous parameter[TERRAPIN_PARAMETER_VISCOUS] int32_t 1/100000000
CALIBRATION.residual calibration.residual_unm int32_t 1/1000000
CALIBRATION.current_zero sense.trim_q8_codes int32_t 1/256
CALIBRATION.step calibration.step uint8_t 1
CALIBRATION.calibrated parameter[TERRAPIN_PARAMETER_CALIBRATED] bool 1
ATTITUDE.pitch inputs.pitch_mrad int16_t 1/1000
ATTITUDE.pitch_valid inputs.pitch_valid bool 1
ATTITUDE.swing_valid inputs.swing_valid bool 1
ATTITUDE.swing_angle inputs.swing_angle_mrad int16_t 1/1000
ATTITUDE.acceleration estimator.acceleration_urad_s2 int32_t 1/1000000
ATTITUDE.angle angle uint16_t turn
HEADING.heading heading.turn uint16_t turn
HEADING.path_x heading.x_um int32_t 1/1000000
HEADING.path_y heading.y_um int32_t 1/1000000
"""
TURN = Fraction("0.00009587379924285257")  # rad; 2 pi/65536 to the digits of a double


def _one(text: str) -> Fraction:
    return TURN if text == "turn" else Fraction(text)


CORE = {
    name: (place, kind, _one(one)) for name, place, kind, one in (line.split() for line in _PLACES.strip().splitlines())
}
PORT = {f"PORT_TIMES.{name}": Fraction(1, 4) for name in ("receive", "sense", "step", "send", "late")}
ELSEWHERE = ("inputs.", "supply", "temperature", "ready", "angle")

_HEAD = """
#include <string.h>
#include "terrapin_pack.h"
#include "terrapin_scaling.h"

static void put(uint8_t *out, const terrapin_frame *frame) {
    out[0] = (uint8_t)(frame->id & 0xFFU);
    out[1] = (uint8_t)(frame->id >> 8U);
    out[2] = frame->length;
    memcpy(&out[3], frame->data, 8);
}
void e2e_protect(int id, uint8_t *data, uint32_t counter) {
    terrapin_frame frame = {.id = (uint16_t)id, .length = 8U};
    memcpy(frame.data, data, 8);
    terrapin_e2e_protect(&frame, counter);
    memcpy(data, frame.data, 8);
}
int e2e_check(int id, int length, const uint8_t *data, uint8_t *last) {
    terrapin_frame frame = {.id = (uint16_t)id, .length = (uint8_t)length};
    memcpy(frame.data, data, 8);
    return (int)terrapin_e2e_check(&frame, last);
}
"""
_CORE_HEAD = """
#include "core.h"
static terrapin_state state;
static terrapin_inputs inputs;
static int32_t supply;
static int32_t temperature;
static uint32_t angle;
static bool ready;
int32_t sense_supply_mv(const terrapin_state *unused) { (void)unused; return supply; }
int32_t sense_temperature_mc(const terrapin_state *unused) { (void)unused; return temperature; }
bool supervisor_ready(const terrapin_state *unused) { (void)unused; return ready; }
static void fresh(void) {
    memset(&state, 0, sizeof state);
    memset(&inputs, 0, sizeof inputs);
    state.gains.wheel_q22 = 1 << 22; /* R/r is 1 */
    state.gains.turn_per_count = 1;
    state.heading.known = true;
}
static void emit(uint32_t slot, int frame, uint8_t *out) {
    terrapin_outputs outputs;
    state.sense.motor_position = (angle << 16U) + (inputs.swing_valid ? integer_turn(inputs.swing_angle_mrad) : 0U);
    if ((frame == 1) && (slot != 0U)) {
        inputs.tick = slot;
    }
    while ((frame == 1) && ((inputs.tick % 10U) != slot)) {
        inputs.tick += 65536U; /* the low half stays, and must be even */
    }
    telemetry_emit(&state, &inputs, &outputs);
    put(out, &outputs.frames[frame]);
}
"""


def _kind(s: Signal) -> str:
    return "uint32_t" if s.unsigned_word else "int32_t"


def _codec(m: Message) -> Iterator[str]:
    name = m.name.lower()
    for way in ("encode", "pack"):
        yield f"int {way}_{name}(const int64_t *in, uint8_t *out) {{ terrapin_{name}_t m; terrapin_frame f;"
        yield from (f"m.{s.name} = ({_kind(s)})in[{i}];" for i, s in enumerate(m.signals))
        yield f"const bool fits = terrapin_{way}_{name}(&m, &f); put(out, &f); return fits ? 1 : 0; }}"
    yield f"int decode_{name}(int id, int length, const uint8_t *data, int64_t *out) {{"
    yield f"struct {{ terrapin_{name}_t m; uint32_t guard; }} w = {{.guard = 0xA5C3F10EU}};"
    yield "terrapin_frame f = {.id = (uint16_t)id, .length = (uint8_t)length};"
    yield f"memcpy(f.data, data, 8); const bool ours = terrapin_decode_{name}(&f, &w.m);"
    yield from (f"out[{i}] = w.m.{s.name};" for i, s in enumerate(m.signals))
    yield "return (w.guard != 0xA5C3F10EU) ? 2 : (ours ? 1 : 0); }"


def _scaled(m: Message) -> Iterator[str]:
    name = m.name.lower()
    yield f"int scale_{name}(const int64_t *in, uint8_t *out) {{ terrapin_{name}_source s; terrapin_frame f;"
    for i, s in enumerate(m.own):
        value = f"in[{i}] != 0" if s.kind == "bool" else f"({s.kind})in[{i}]"
        yield f"s.{s.source or s.name} = {value};"
        yield f'_Static_assert(_Generic(s.{s.source or s.name}, {s.kind}: 1, default: 0), "{s.name}: its kind");'
    yield f"const terrapin_{name}_t m = terrapin_scale_{name}(&s);"
    yield f"const bool fits = terrapin_encode_{name}(&m, &f); put(out, &f); return fits ? 1 : 0; }}"


def _sent(m: Message) -> Iterator[str]:
    """Through telemetry.c."""
    yield f"void send_{m.name.lower()}(const int64_t *in, uint8_t *out) {{ fresh();"
    for i, s in enumerate(m.own):
        if f"{m.name}.{s.name}" not in CORE:  # a new signal: its way through `source` is looked at all the same
            continue
        place, kind, _ = CORE[f"{m.name}.{s.name}"]
        cast = {"bool": f"in[{i}] != 0", "held": f"(int32_t)in[{i}]"}.get(kind, f"({kind})in[{i}]")
        yield f"{place if place.startswith(ELSEWHERE) else 'state.' + place} = {cast};"
    slot = 0 if m.name == "ACTUATE" else SLOTS.index(m.name)
    yield f"emit({slot}U, {int(m.name != 'ACTUATE')}, out); }}"


def _constants(r: Reference) -> Iterator[str]:
    def same(name: str, value: int) -> str:
        return f'_Static_assert({name.upper()} == {"(-2147483647 - 1)" if value == -(2**31) else value}, "{name}");'

    t = r.toml
    yield same("terrapin_interface_version", t["controller"]["version"])
    for enum, entry in t.get("enum", {}).items():
        yield from (same(f"terrapin_{enum}_{key}", value) for key, value in entry["values"].items())
    for name, entry in t.get("fault", {}).items():
        yield same(f"terrapin_fault_{name}", entry["number"])
    yield same("terrapin_faults_known", sum(1 << e["number"] for e in t.get("fault", {}).values()))
    yield same("terrapin_faults_latched", sum(1 << e["number"] for e in t.get("fault", {}).values() if e["latched"]))
    for index, name in enumerate(t.get("parameter", {})):
        yield same(f"terrapin_parameter_{name}", index)
    yield same("terrapin_parameter_count", len(t.get("parameter", {})))
    for kind, prefix in (("limit", "limit_"), ("constant", ""), ("promise", "promise_")):
        for name, entry in t.get(kind, {}).items():
            if entry["value"] == int(entry["value"]) and abs(entry["value"]) < 2**31:
                yield same(f"terrapin_{prefix}{name}", int(entry["value"]))
            else:
                yield f"#ifdef TERRAPIN_{prefix.upper()}{name.upper()}\n#error no whole number of 32 bits\n#endif"
    for m in r.messages:
        yield same(f"terrapin_id_{m.name}", m.id)
        yield same(f"terrapin_length_{m.name}", m.length)


def driver(r: Reference, messages: Sequence[Message], core: bool) -> str:
    """C source that reaches `messages`; `core`: telemetry.c is linked, and fills what it sends."""
    out = [_HEAD, *_constants(r)]
    for m in messages:
        out += _codec(m)
        if m.telemetry:
            out += _scaled(m)
    if core:
        out += [_CORE_HEAD]
        for m in messages:
            if m.name in ("ACTUATE", *SLOTS):
                out += _sent(m)
    return "\n".join(out)
