/* step_count TICKS: runs the controller that often, rolling at 5 V, for counting instructions under callgrind.
 * Two runs of different length, subtracted, give the cost of one step without start and end of the program. */
#include <stdio.h>
#include <stdlib.h>

#include "terrapin.h"
#include "terrapin_interface.h"

int main(int argc, char **argv) {
    const uint32_t ticks = argc == 2 ? (uint32_t)strtoul(argv[1], NULL, 10) : 0U;
    terrapin_state *state = malloc(terrapin_state_size());
    terrapin_outputs outputs = {0};
    if (state == NULL || ticks == 0U) {
        (void)fputs("usage: step_count TICKS\n", stderr);
        free(state);
        return 2;
    }
    terrapin_init(state);
    /* Codes of a robot that rolls steadily while the bridge is on: 0.6 A, 12 V, 25 degC, drive wheel about 20 rad/s. */
    terrapin_inputs inputs = {.supply_code = 3000U, .temperature_code = 1500U};
    inputs.swing_valid = true;
    inputs.command.limiter = true;
    inputs.command.setpoint = 5000;
    inputs.command.request = TERRAPIN_REQUEST_RUN;
    for (uint32_t tick = 0U; tick < ticks; tick++) {
        inputs.tick = tick;
        inputs.current_code = outputs.enable ? 2648U : 2048U;
        inputs.motor_count = (uint16_t)(inputs.motor_count + (outputs.enable ? 6U + (tick & 1U) : 0U));
        inputs.ground_count = (uint16_t)(inputs.ground_count + (outputs.enable ? 4U : 0U));
        inputs.command_fresh = tick % 50U == 0U;
        terrapin_step(state, &inputs, &outputs);
    }
    (void)printf("enabled %d, faults 0x%lx\n", (int)outputs.enable, (unsigned long)outputs.faults);
    free(state);
    return 0;
}
