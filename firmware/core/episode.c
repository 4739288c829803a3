/* What every state of the supervisor is made of: it is entered, and what came of a request is reported. */
#include "core.h"

void episode_enter(terrapin_state *state, int32_t next, terrapin_phase phase) {
    TERRAPIN_ASSERT((next >= TERRAPIN_STATE_BOOT) && (next <= TERRAPIN_STATE_SAFE));
    TERRAPIN_ASSERT(phase <= PHASE_HALT);
    state->supervisor.state = next;
    state->supervisor.phase = phase;
    state->supervisor.timer_ms = 0U;
}

void episode_report(terrapin_state *state, int32_t report, int32_t distance_mm) {
    terrapin_supervisor *s = &state->supervisor;
    TERRAPIN_ASSERT((report > TERRAPIN_REPORT_NONE) && (report <= TERRAPIN_REPORT_EXTRICATION_FAILED));
    s->report = report;
    s->report_number = (uint8_t)((s->report_number + 1U) & 0xFU);
    s->report_distance_mm = distance_mm;
    const uint32_t duration = s->episode_ms / 10U;
    const uint32_t held = (duration < UINT16_MAX) ? duration : UINT16_MAX;
    s->report_duration_10ms = (int32_t)held;
    TERRAPIN_ASSERT(s->report_number <= 0xFU);
}
