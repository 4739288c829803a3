/* What holds of the controller's state between any two of its functions. Each proof of a part of the step begins in any
 * state of which this holds, and shows that it holds again; so what one part makes, another may rest on.
 *
 * Gains that are made by integer_gain_of and integer_wide_of (gains.c alone does) keep their product within
 * INTEGER_MOST: tests/python/test_proof.py holds it.
 */
#ifndef INVARIANT_H
#define INVARIANT_H

#include "integers.h"

#include "core.h"
#include "ranges.h" /* PARAMETERS_HOLD(state), made from controller.toml */

enum { HELD_OR_LEAST = 0x40000000 }; /* what integer_hold and integer_q_held may answer, either way */

static bool within(int32_t value, int32_t most) {
    return (value <= most) && (value >= -most);
}

static bool gains_hold(const terrapin_state *s) {
    const terrapin_gains *g = &s->gains;
    const terrapin_rates *r = &s->rates;
    return (g->count_e5_urad > 0) && (g->count_e5_urad < 0x20000000) && (g->ground_e5_um > 0) &&
           (g->ground_e5_um < 0x4000000) && (g->turn_per_count >= 0) && (g->turn_per_count <= 0x200000) &&
           (g->torque_unm_per_a > 0) && (g->torque_unm_per_a <= 500000000) && (g->weight_unm >= 10000) &&
           (g->weight_unm <= 250000000) && (g->span_mv >= 0) && (g->span_mv <= 200000) && (g->window_slots >= 10U) &&
           (g->window_slots <= (uint32_t)WINDOW_MAX_SLOTS) && within(g->zero_q8, 6000000) &&
           (g->fixed_variance <= 750000000000000000U) && within(g->trimmed_unm, HELD_OR_LEAST) &&
           within(g->untrimmed_unm, HELD_OR_LEAST) && within(g->floor_unm, HELD_OR_LEAST) && (g->gain_q30 >= 0) &&
           (g->gain_q30 <= 0x40000000) && is_gain(&g->half_urad) && is_gain(&g->way_um) && (g->current_q32 >= 0) &&
           (g->recent_q28 >= 0) && (g->voltage_q32 >= 0) && (g->swing_q20 >= 0) && (g->swing_q20 <= 0x800000) &&
           (g->per_weight_q24 >= 0) && within(g->slope_q24, 0x10000000) && (g->wheel_q22 >= 0) &&
           within(g->heat_q24, 0x20000000) && (g->stribeck_q16 >= 0) && within(g->speed_squared_q24, INT32_MAX) &&
           within(g->comp_viscous_q32, INT32_MAX) && within(g->comp_inertia_q30, 0x40000000) && (g->inertia_q30 >= 0) &&
           (g->inertia_q30 <= 0x40000000) && (g->weight_q22 >= 0) && is_gain(&r->motor_speed) &&
           is_gain(&r->motor_fast) && is_gain(&r->ground_fast) && is_gain(&r->swing_fast) &&
           is_gain(&r->motor_window) && is_gain(&r->ground_window) && is_gain(&r->shell_per_rim) && is_wide(&r->emf) &&
           (r->rim_q32 >= 0x2000000) && (r->shell_q24 >= 0) && (r->keep_q30 >= 0) && (r->keep_q30 <= 0x40000000) &&
           (r->drop_q32 >= 0) && (r->rise_q20 >= 0) && (r->rise_q20 < 0x1000000) && (r->speed_ki_q32 >= 0) &&
           (r->speed_ki_q32 <= 0x40000000) && (r->slip_ki_q32 >= 0) && (r->slip_ki_q32 <= 0x40000000) &&
           (r->dead_urad_s >= 50000) && (r->dead_urad_s <= 5000000) && (r->margin_counts >= 0);
}

static bool sense_holds(const terrapin_state *s) {
    const terrapin_sense *n = &s->sense;
    bool good = (n->current_code >= 0) && (n->current_code <= UINT16_MAX) && within(n->current_ua, HELD_OR_LEAST) &&
                (n->supply_q8_mv >= 0) && (n->supply_q8_mv < 0x20000000) &&
                within(n->temperature_q8_mc, INTEGER_MOST) && (n->temperature_known || (n->temperature_q8_mc == 0)) &&
                within(n->trim_q8_codes, 16 * 256) && (n->trim_count < (uint16_t)TRIM_TICKS) &&
                (n->causes < (1U << (uint32_t)SENSED_FAULTS)) && (n->encoder_quarters <= 800U);
    for (uint32_t i = 0U; i < (uint32_t)SENSED_FAULTS; i++) {
        good = good && (n->fault_ticks[i] <= ((i <= 1U) ? 3U : 20U));
    }
    return good;
}

static bool slip_holds(const terrapin_state *s) {
    const terrapin_slip_state *p = &s->slip;
    return (p->newest < (uint8_t)FAST_TICKS) && (p->ticks <= (uint16_t)FAST_TICKS) &&
           within(p->wheel_urad_s, INTEGER_MOST) && within(p->emf_uv, INTEGER_MOST) &&
           within(p->shell_urad_s, HELD_OR_LEAST) && within(p->ground_um_s, INTEGER_MOST) &&
           (p->disagree_ticks <= 500U) && (p->doubt_ticks <= 500U) && within(p->slip_e4, 40000) && (p->peak_e4 >= 0) &&
           (p->peak_e4 <= 10000);
}

static bool drive_holds(const terrapin_state *s) {
    const terrapin_drive *d = &s->drive;
    return within(d->reference_urad_s, INTEGER_MOST) && within(d->speed_integral_uv, 20000000) &&
           within(d->limiter_integral_uv, 20000000) && within(d->limiter_direction, 1) && (d->trim_mv >= 0) &&
           (d->trim_mv <= s->gains.span_mv) && (d->enable || (d->trim_mv == 0)) && within(d->applied_mv, 2097151) &&
           (d->enable || (d->duty_q15 == 0));
}

static bool estimator_holds(const terrapin_state *s) {
    const terrapin_estimator *e = &s->estimator;
    const uint32_t n = s->gains.window_slots;
    return (e->newest < (uint16_t)HISTORY_SLOTS) && (e->slots <= (uint16_t)HISTORY_SLOTS) &&
           (!e->open || !e->ready || (e->slots > n)) &&
           (!e->open || !e->full || (e->ready && (e->slots > ((2U * n) + (uint32_t)BLOCK_SLOTS)))) &&
           (e->quiet_slots <= 20U) && (e->ripple_unm >= 0) && (e->ripple_unm <= INTEGER_MOST) &&
           within(e->motor_unm, HELD_OR_LEAST) && within(e->friction_unm, 0x40200000) &&
           within(e->torque_unm, TERRAPIN_LIMIT_TORQUE_FULL_SCALE) && (e->sd_unm >= 0) &&
           within(e->omega_urad_s, INTEGER_MOST) && within(e->acceleration_urad_s2, HELD_OR_LEAST) &&
           (e->momentum_unm >= 0) && (e->momentum_unm <= INTEGER_MOST) && within(e->current_10ua, 10000000) &&
           within(e->recent_ua, HELD_OR_LEAST) && within(e->beyond_unm, INTEGER_MOST) &&
           within(e->counts, WINDOW_MAX_SLOTS * RECORD_MS * 32768) && within(e->current_q8, INTEGER_MOST);
}

static bool supervisor_holds(const terrapin_state *s) {
    const terrapin_supervisor *v = &s->supervisor;
    return (v->phase >= PHASE_FIRST) && (v->phase <= PHASE_HALT) && within(v->setpoint, 32768) &&
           within(v->stuck_pitch_mrad, 32768) && within(v->rolling_ua, HELD_OR_LEAST);
}

static bool heading_holds(const terrapin_state *s) {
    return within(s->heading.x_um, 520000000) && within(s->heading.y_um, 520000000);
}

static bool state_holds(const terrapin_state *s) {
    return gains_hold(s) && sense_holds(s) && slip_holds(s) && drive_holds(s) && estimator_holds(s) &&
           supervisor_holds(s) && heading_holds(s);
}

#endif
