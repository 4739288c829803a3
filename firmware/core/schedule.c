/* Which tick does what. The estimator and the ground share ten ticks, so that no tick is much longer than another; each
 * part reads what the part before it has left. A window closes at WINDOW_TICK, of a robot with longer windows every few
 * slots only (RECORD_MS), and is told by GROUND GROUND_AGE_MS later, then again until the next.
 *
 *     tick % 10   work                                              message of telemetry.c, after it
 *     4           the window closes, before slip and drive, which   WINDOW: of the last whole one
 *                 know the history
 *     5           its means: current, voltage, speed                FIT
 *     6           its acceleration, its speed squared               REPORT
 *     7           bound of its angular momentum; friction inside    CALIBRATION
 *                 the robot beyond A sgn + B w
 *     8           imbalance, then C_t                               ATTITUDE
 *     9           its sd, the gate                                  HEADING
 *     0           f_r                                               STATUS
 *     1           the nearest terrain                               GROUND: of this window
 *     2, 3, 4     the fit takes a fresh window in, step by step     MOTION, ELECTRICAL
 *     3           heading and path
 *     5, 6        a step of a calibration's fit, when there is one
 *
 * When the history begins anew, the window under way is given up; the fit still takes in the one before.
 */
#include "core.h"

enum { WINDOW_TICK = 4, GROUND_TICK = 1, PATH_TICK = 3, HEADING_TICK = 9 };

_Static_assert(((int32_t)GROUND_TICK + (int32_t)SLOT_MS - (int32_t)WINDOW_TICK) == TERRAPIN_GROUND_AGE,
               "as controller.toml states");
_Static_assert(((int32_t)HEADING_TICK - (int32_t)PATH_TICK) == TERRAPIN_HEADING_AGE, "as controller.toml states");

void schedule_sense(terrapin_state *state, const terrapin_inputs *inputs) {
    estimator_tick(state, inputs); /* with the voltage that stood until now */
    if ((inputs->tick % (uint32_t)RECORD_MS) == (uint32_t)WINDOW_TICK) {
        estimator_close(state);
    }
}

void schedule_work(terrapin_state *state, const terrapin_inputs *inputs) {
    const uint32_t number = inputs->tick % (uint32_t)SLOT_MS;
    switch (number) {
    case 5U:
        estimator_means(state);
        calibration_work(state);
        break;
    case 6U:
        estimator_acceleration(state);
        ground_speed(state);
        calibration_work(state);
        break;
    case 7U:
        estimator_momentum(state);
        estimator_friction_beyond(state);
        break;
    case 8U:
        estimator_torque(state);
        break;
    case 9U:
        estimator_deviation(state);
        estimator_gate(state);
        break;
    case 0U:
        ground_resistance(state);
        break;
    case (uint32_t)GROUND_TICK:
        ground_nearest(state);
        break;
    case (uint32_t)PATH_TICK:
        ground_fit_work(state);
        heading_slot(state, inputs);
        break;
    case (uint32_t)WINDOW_TICK:
        ground_fit_work(state);
        if ((inputs->tick % (uint32_t)RECORD_MS) == (uint32_t)WINDOW_TICK) {
            estimator_open(state, inputs);
        }
        break;
    default: /* 2 */
        ground_fit_work(state);
        break;
    }
}
