#include "fmu.h"

#include <math.h>
#include <string.h>

#include "model.inc"

void fmu_defaults(fmu_model *model) {
    memset(model, 0, sizeof *model);
    memcpy(model->float64, FMU_FLOAT64_START, sizeof FMU_FLOAT64_START);
    memcpy(model->int32, FMU_INT32_START, sizeof FMU_INT32_START);
    memcpy(model->int64, FMU_INT64_START, sizeof FMU_INT64_START);
    memcpy(model->uint64, FMU_UINT64_START, sizeof FMU_UINT64_START);
    memcpy(model->boolean, FMU_BOOLEAN_START, sizeof FMU_BOOLEAN_START);
}

#if FMU_CONTROLLER
static void say(fmu_model *model, const fmu_signal *signal, uint64_t data) {
    const uint64_t sign = signal->is_signed ? UINT64_C(1) << (signal->length - 1U) : 0U;
    const uint64_t bits = (data >> signal->start) & ((UINT64_C(1) << signal->length) - 1U);
    const int64_t raw = (int64_t)(bits ^ sign) - (int64_t)sign;
    if (signal->reference < FMU_INT32) {
        model->float64[signal->reference - FMU_FLOAT64] = (double)raw * signal->scale;
    } else if (signal->reference < FMU_BOOLEAN) {
        model->int64[signal->reference - FMU_INT64] = raw;
    } else {
        model->boolean[signal->reference - FMU_BOOLEAN] = raw != 0;
    }
}

/* Bridge, frames and signals of a step as variables. */
static void tell(fmu_model *model) {
    const terrapin_outputs *out = &model->outputs;
    model->int32[FMU_DUTY_Q15] = out->duty_q15;
    model->boolean[FMU_ENABLE] = out->enable;
    model->uint64[FMU_FAULTS] = out->faults;
    model->int32[FMU_FRAME_COUNT] = out->frame_count;
    for (int i = 0; i < TERRAPIN_MAX_FRAMES; i++) {
        const bool there = i < out->frame_count;
        uint64_t data = 0;
        for (unsigned b = 0; there && (b < out->frames[i].length); b++) {
            data |= (uint64_t)out->frames[i].data[b] << (8U * b);
        }
        model->int32[FMU_FRAME_ID + i] = there ? out->frames[i].id : -1;
        model->int32[FMU_FRAME_LENGTH + i] = there ? out->frames[i].length : 0;
        model->uint64[FMU_FRAME_DATA + i] = data;
        for (int s = 0; there && (s < FMU_SIGNALS); s++) {
            if (FMU_SIGNAL[s].id == out->frames[i].id) {
                say(model, &FMU_SIGNAL[s], data);
            }
        }
    }
}

static const char *start_controller(fmu_model *model) {
    int32_t values[TERRAPIN_PARAMETER_COUNT];
    for (int i = 0; i < TERRAPIN_PARAMETER_COUNT; i++) {
        const double raw = rint(model->float64[FMU_PARAMETER + i] / FMU_PARAMETER_SCALE[i]);
        if (!(fabs(raw) <= 2147483647.0)) {
            return FMU_PARAMETER_NAME[i];
        }
        values[i] = (int32_t)raw;
    }
    if (terrapin_state_size() > sizeof model->memory) {
        return "the controller's memory";
    }
    terrapin_state *state = (terrapin_state *)model->memory;
    terrapin_init(state);
    for (int i = 0; i < TERRAPIN_PARAMETER_COUNT; i++) {
        if (terrapin_parameter_set(state, (uint16_t)i, values[i]) != TERRAPIN_PARAMETER_OK) {
            return FMU_PARAMETER_NAME[i];
        }
    }
    memset(&model->outputs, 0, sizeof model->outputs);
    tell(model);
    return NULL;
}

static void step(fmu_model *model, const terrapin_inputs *in) {
    terrapin_step((terrapin_state *)model->memory, in, &model->outputs);
    tell(model);
}
#endif

#if FMU_PLANT
void fmu_restored(fmu_model *model) {
    const uint64_t seed = model->simulator.config.seed;
    model->simulator.config = FMU_CONFIG;
    model->simulator.config.seed = seed;
}

static void sense(fmu_model *model) {
    hil_sense(&model->simulator, &model->record);
    memcpy(&model->float64[FMU_TRUTH], model->record.truth, sizeof model->record.truth);
    model->float64[FMU_BETA] = model->simulator.body.position[HIL_BETA];
    model->float64[FMU_ALPHA] = model->simulator.body.position[HIL_ALPHA];
}

static void start_plant(fmu_model *model) {
    memset(&model->simulator, 0, sizeof model->simulator);
    model->simulator.config.seed = model->uint64[FMU_SEED];
    fmu_restored(model);
    hil_start(&model->simulator);
    sense(model);
}
#else
void fmu_restored(fmu_model *model) {
    (void)model;
}
#endif

#if FMU_CONTROLLER && FMU_PLANT

const char *fmu_start(fmu_model *model) {
    start_plant(model);
    return start_controller(model);
}

void fmu_advance(fmu_model *model, uint32_t ticks) {
    hil_simulator *simulator = &model->simulator;
    for (uint32_t i = 0; i < ticks; i++) {
        if (!simulator->silent) {
            step(model, &simulator->inputs);
        }
        hil_act(simulator, model->outputs.duty_q15, model->outputs.enable);
        sense(model);
    }
}

#elif FMU_CONTROLLER

const char *fmu_start(fmu_model *model) {
    return start_controller(model);
}

void fmu_advance(fmu_model *model, uint32_t ticks) {
    for (uint32_t i = 0; i < ticks; i++) {
        const int32_t tick = model->int32[FMU_TICK];
        const terrapin_inputs in = {
            .tick = (tick < 0) ? model->ticks + i : (uint32_t)tick + i,
            .current_code = (uint16_t)model->int32[FMU_CURRENT_CODE],
            .supply_code = (uint16_t)model->int32[FMU_SUPPLY_CODE],
            .temperature_code = (uint16_t)model->int32[FMU_TEMPERATURE_CODE],
            .motor_count = (uint16_t)model->int32[FMU_MOTOR_COUNT],
            .ground_count = (uint16_t)model->int32[FMU_GROUND_COUNT],
            .swing_angle_mrad = (int16_t)model->int32[FMU_SWING_ANGLE_MRAD],
            .swing_rate_centirad_s = (int16_t)model->int32[FMU_SWING_RATE_CENTIRAD_S],
            .pitch_mrad = (int16_t)model->int32[FMU_PITCH_MRAD],
            .ground_speed_mm_s = (int16_t)model->int32[FMU_GROUND_SPEED_MM_S],
            .heading_turn = (uint16_t)model->int32[FMU_HEADING_TURN],
            .swing_valid = model->boolean[FMU_SWING_VALID],
            .pitch_valid = model->boolean[FMU_PITCH_VALID],
            .ground_speed_valid = model->boolean[FMU_GROUND_SPEED_VALID],
            .heading_valid = model->boolean[FMU_HEADING_VALID],
            .estop = model->boolean[FMU_ESTOP],
            .command_fresh = (i == 0U) && model->boolean[FMU_COMMAND_FRESH], /* one COMMAND, not one each tick */
            .command = {.request = (uint8_t)model->int32[FMU_REQUEST],
                        .control = (uint8_t)model->int32[FMU_CONTROL],
                        .limiter = model->boolean[FMU_LIMITER],
                        .setpoint = (int16_t)model->int32[FMU_SETPOINT]},
        };
        if (!model->boolean[FMU_SILENT]) {
            step(model, &in);
        }
    }
}

#else

/* What the controller is to be given, as variables. */
static void wire(fmu_model *model) {
    const terrapin_inputs *in = &model->simulator.inputs;
    model->int32[FMU_TICK] = (int32_t)(model->simulator.tick & 0x7FFFFFFFU);
    model->int32[FMU_CURRENT_CODE] = in->current_code;
    model->int32[FMU_SUPPLY_CODE] = in->supply_code;
    model->int32[FMU_TEMPERATURE_CODE] = in->temperature_code;
    model->int32[FMU_MOTOR_COUNT] = in->motor_count;
    model->int32[FMU_GROUND_COUNT] = in->ground_count;
    model->int32[FMU_SWING_ANGLE_MRAD] = in->swing_angle_mrad;
    model->int32[FMU_SWING_RATE_CENTIRAD_S] = in->swing_rate_centirad_s;
    model->int32[FMU_PITCH_MRAD] = in->pitch_mrad;
    model->int32[FMU_GROUND_SPEED_MM_S] = in->ground_speed_mm_s;
    model->int32[FMU_HEADING_TURN] = in->heading_turn;
    model->int32[FMU_REQUEST] = in->command.request;
    model->int32[FMU_CONTROL] = in->command.control;
    model->int32[FMU_SETPOINT] = in->command.setpoint;
    model->boolean[FMU_SWING_VALID] = in->swing_valid;
    model->boolean[FMU_PITCH_VALID] = in->pitch_valid;
    model->boolean[FMU_GROUND_SPEED_VALID] = in->ground_speed_valid;
    model->boolean[FMU_HEADING_VALID] = in->heading_valid;
    model->boolean[FMU_ESTOP] = in->estop;
    model->boolean[FMU_COMMAND_FRESH] = in->command_fresh;
    model->boolean[FMU_LIMITER] = in->command.limiter;
    model->boolean[FMU_SILENT] = model->simulator.silent;
}

const char *fmu_start(fmu_model *model) {
    start_plant(model);
    wire(model);
    return NULL;
}

void fmu_advance(fmu_model *model, uint32_t ticks) {
    hil_simulator *simulator = &model->simulator;
    for (uint32_t i = 0; i < ticks; i++) {
        if (simulator->silent) { /* nothing reaches the bridge either: it holds */
            hil_act(simulator, simulator->duty, simulator->enabled);
        } else {
            hil_act(simulator, (int16_t)model->int32[FMU_DUTY_Q15], model->boolean[FMU_ENABLE]);
        }
        sense(model);
    }
    wire(model);
}

#endif
