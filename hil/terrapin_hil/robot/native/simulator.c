#include "simulator.h"

#include <math.h>
#include <string.h>

#include "terrapin_interface.h"
#include "extremes.h"
#include "heading.h"
#include "path.h"

#define TICK          1e-3
#define SLIP_DEADBAND 0.01
#define DUTY_ONE      32768.0
#define TWO_PI        6.28318530717958647692

static double profile_at(const hil_profile *profile, double time) {
    int i = 1;
    while (i < profile->count && time > profile->time[i]) {
        i++;
    }
    if (i == profile->count) {
        return profile->value[profile->count - 1];
    }
    const double share = (time - profile->time[i - 1]) / (profile->time[i] - profile->time[i - 1]);
    return profile->value[i - 1] + larger(share, 0.0) * (profile->value[i] - profile->value[i - 1]);
}

static bool carried(const hil_profile *carriage, double time) {
    return carriage->count > 0 && time >= carriage->time[0] && time <= carriage->time[carriage->count - 1];
}

static double now(const hil_simulator *simulator) {
    return TICK * (double)simulator->tick;
}

/* Most runs have no faults, and a tick asks a dozen times. */
static inline const hil_fault *active(const hil_simulator *simulator, int kind, int channel) {
    const hil_faults *faults = &simulator->config.faults;
    return faults->count > 0 ? hil_fault_active(faults, kind, channel, now(simulator)) : NULL;
}

static inline bool failing(const hil_simulator *simulator, int kind, int channel) {
    return active(simulator, kind, channel) != NULL;
}

uint64_t hil_layout(void) {
    return ((uint64_t)sizeof(hil_simulator) << 32U) | sizeof(hil_record);
}

void hil_start(hil_simulator *simulator) {
    const hil_config *config = &simulator->config;
    simulator->derived = hil_robot_derive(&config->robot);
    memset(&simulator->body, 0, sizeof simulator->body);
    memset(&simulator->inputs, 0, sizeof simulator->inputs);
    memset(&simulator->around, 0, sizeof simulator->around);
    simulator->body.position[HIL_X] = config->start_position;
    simulator->body.load = simulator->derived.weight;
    const hil_ground ground = hil_path_at(&config->path, config->start_position);
    if (config->path.segment[ground.segment].contact != NULL) { /* put down, it sinks in by its weight */
        double unused;
        const double load = simulator->derived.weight * cos(ground.slope);
        const hil_grip grip = hil_path_grip(&config->path, &ground, load, 0.0, 0.0, 1.0);
        simulator->body.sinkage = hil_grip_value(&grip, HIL_SINKAGE, 0.0, &unused);
    }
    hil_sensors_start(&simulator->sensors, config->seed);
    hil_faults_start(&simulator->failing, config->seed);
    simulator->temperature =
        config->winding.profile.count > 0 ? profile_at(&config->winding.profile, 0.0) : config->winding.start;
    simulator->heading = config->steering.count > 0 ? profile_at(&config->steering, 0.0) : 0.0;
    simulator->path[0] = simulator->path[1] = 0.0;
    simulator->contact_torque = 0.0;
    simulator->supply = config->supply;
    simulator->duty = 0;
    simulator->enabled = false;
    simulator->silent = false;
    simulator->tick = 0;
    simulator->commands = 0;
}

/* What a channel says, read every so many ms. */
static int32_t told(hil_simulator *simulator, int channel, int32_t reading, int32_t zero, int32_t low, int32_t high,
                    int every) {
    const hil_faults *faults = &simulator->config.faults;
    return faults->count == 0 ? reading
                              : hil_fault_reading(faults, &simulator->failing, channel, reading, zero, low, high, every,
                                                  now(simulator));
}

static uint16_t converted(hil_simulator *simulator, int channel, int every) {
    const hil_sensors *sensors = &simulator->config.sensors;
    const int32_t code = hil_adc_read(sensors, &simulator->sensors, channel);
    const int32_t zero = (int32_t)lrint(sensors->adc[channel].zero);
    return (uint16_t)told(simulator, channel, code, zero, 0, 4095, every);
}

static void read_fast(hil_simulator *simulator) {
    const hil_config *config = &simulator->config;
    terrapin_inputs *in = &simulator->inputs;
    in->current_code = converted(simulator, HIL_CURRENT, 1);
    uint16_t count[HIL_ENCODERS];
    for (int i = 0; i < HIL_ENCODERS; i++) {
        const hil_fault *fault = active(simulator, HIL_FAULT_LOST_COUNTS, HIL_MOTOR + i);
        const double lost = fault != NULL ? fault->value : 0.0;
        const bool reversed = failing(simulator, HIL_FAULT_REVERSED, HIL_MOTOR + i);
        const int32_t read = hil_encoder_read(&config->sensors, &simulator->sensors, i, reversed ? HIL_REVERSED : lost);
        count[i] = (uint16_t)(uint32_t)told(simulator, HIL_MOTOR + i, read, 0, 0, 0, 1);
    }
    in->motor_count = count[0];
    in->ground_count = count[1];
    in->swing_valid = config->sensors.digital[0].present && config->sensors.digital[1].present &&
                      !failing(simulator, HIL_FAULT_ABSENT, HIL_SWING_ANGLE) &&
                      !failing(simulator, HIL_FAULT_ABSENT, HIL_SWING_RATE);
    in->pitch_valid = config->sensors.digital[2].present && !failing(simulator, HIL_FAULT_ABSENT, HIL_PITCH);
    in->ground_speed_valid =
        config->sensors.digital[3].present && !failing(simulator, HIL_FAULT_ABSENT, HIL_GROUND_SPEED);
    in->heading_valid = config->steering.count > 0;
    if (in->heading_valid) { /* else it stays 0, where the heading is */
        in->heading_turn = (uint16_t)(uint32_t)(int32_t)floor(simulator->heading * (65536.0 / TWO_PI) + 0.5);
    }
    in->estop = failing(simulator, HIL_FAULT_ESTOP, -1);
}

static void read_slow(hil_simulator *simulator) {
    const hil_config *config = &simulator->config;
    terrapin_inputs *in = &simulator->inputs;
    const int channel = (simulator->tick & 1U) == 0U ? HIL_SUPPLY : HIL_TEMPERATURE;
    uint16_t *code = channel == HIL_SUPPLY ? &in->supply_code : &in->temperature_code;
    *code = converted(simulator, channel, 2);
    int16_t *digital[HIL_DIGITALS] = {&in->swing_angle_mrad, &in->swing_rate_centirad_s, &in->pitch_mrad,
                                      &in->ground_speed_mm_s};
    for (int i = 0; i < HIL_DIGITALS; i++) {
        const int16_t value = hil_digital_read(&config->sensors, &simulator->sensors, i);
        const int32_t most = (int32_t)config->sensors.digital[i].largest;
        *digital[i] = (int16_t)told(simulator, HIL_SWING_ANGLE + i, value, 0, -most - 1, most, 1);
    }
}

static void read_command(hil_simulator *simulator) {
    const hil_config *config = &simulator->config;
    const hil_order *order = NULL;
    for (int i = 0; i < config->order_count && config->order[i].time <= now(simulator); i++) {
        order = &config->order[i];
    }
    if (order == NULL || failing(simulator, HIL_FAULT_COMMAND_SILENCE, -1)) {
        return;
    }
    terrapin_inputs *in = &simulator->inputs;
    in->command_fresh = true;
    simulator->commands++;
    in->command.request = order->request;
    in->command.control = order->control;
    in->command.limiter = order->limiter;
    in->command.setpoint = order->setpoint;
}

static void encode_slow(const terrapin_inputs *in, hil_record *record) {
    const bool supply = (in->tick & 1U) == 0U;
    const terrapin_sensors_slow_t message = {
        .slow_code = supply ? in->supply_code : in->temperature_code,
        .slow_channel = supply ? 0 : 1,
        .swing_angle = in->swing_angle_mrad,
        .swing_rate = in->swing_rate_centirad_s,
        .pitch = in->pitch_mrad,
        .ground_speed = in->ground_speed_mm_s,
    };
    (void)terrapin_encode_sensors_slow(&message, &record->host[record->host_count++]); /* read within its range */
}

static void encode_command(const terrapin_inputs *in, hil_record *record) {
    const terrapin_command_t message = {.request = in->command.request,
                                        .control = in->command.control,
                                        .limiter = in->command.limiter ? 1 : 0,
                                        .setpoint = in->command.setpoint};
    terrapin_frame *frame = &record->host[record->host_count++];
    (void)terrapin_encode_command(&message, frame);
    terrapin_e2e_protect(frame, record->commands);
}

static void encode_heading(const terrapin_inputs *in, hil_record *record) {
    const terrapin_sensors_heading_t message = {.heading = in->heading_turn, .heading_valid = 1};
    (void)terrapin_encode_sensors_heading(&message, &record->host[record->host_count++]);
}

static void encode_fast(const terrapin_inputs *in, hil_record *record) {
    const terrapin_sensors_fast_t message = {
        .current_code = in->current_code,
        .estop = in->estop ? 1 : 0,
        .swing_valid = in->swing_valid ? 1 : 0,
        .pitch_valid = in->pitch_valid ? 1 : 0,
        .ground_speed_valid = in->ground_speed_valid ? 1 : 0,
        .motor_count = in->motor_count,
        .ground_count = in->ground_count,
        .tick = (int32_t)(in->tick & 0xFFFFU),
    };
    (void)terrapin_encode_sensors_fast(&message, &record->host[record->host_count++]);
}

void hil_frames(hil_record *records, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        hil_record *record = &records[i];
        const terrapin_inputs *in = &record->inputs;
        record->host_count = 0;
        if (record->silent) {
            continue;
        }
        if (in->tick % HIL_COMMAND_TICKS != 0U) {
            encode_slow(in, record);
        } else if (in->command_fresh) {
            encode_command(in, record);
        }
        if (in->heading_valid) {
            encode_heading(in, record);
        }
        encode_fast(in, record);
    }
}

static void write_truth(const hil_simulator *simulator, double *truth) {
    const hil_body *body = &simulator->body;
    const double rim = simulator->config.robot.radius * body->rate[HIL_BETA];
    const double axle = body->rate[HIL_X];
    const double fastest = larger(fabs(rim), fabs(axle));
    const hil_ground ground = hil_path_inlined(&simulator->config.path, body->position[HIL_X]);
    truth[HIL_TRUTH_TIME] = now(simulator);
    truth[HIL_TRUTH_POSITION] = body->position[HIL_X];
    truth[HIL_TRUTH_SPEED] = axle;
    truth[HIL_TRUTH_OMEGA] = body->rate[HIL_BETA];
    truth[HIL_TRUTH_ALPHA_RATE] = body->rate[HIL_ALPHA];
    truth[HIL_TRUTH_SWING_ANGLE] = body->position[HIL_ALPHA] - body->position[HIL_BETA];
    truth[HIL_TRUTH_SWING_RATE] = body->rate[HIL_ALPHA] - body->rate[HIL_BETA];
    truth[HIL_TRUTH_SLIP] = fastest < SLIP_DEADBAND ? 0.0 : copysign(1.0, rim) * (rim - axle) / fastest;
    truth[HIL_TRUTH_CONTACT_TORQUE] = simulator->contact_torque;
    truth[HIL_TRUTH_RESISTANCE] = body->friction[HIL_BETA];
    truth[HIL_TRUTH_TRACTION] = body->traction;
    truth[HIL_TRUTH_MOTOR_TORQUE] = body->motor_torque;
    truth[HIL_TRUTH_INTERNAL_FRICTION] = body->internal_friction;
    truth[HIL_TRUTH_CURRENT] = body->current;
    truth[HIL_TRUTH_VOLTAGE] = simulator->enabled ? simulator->duty / DUTY_ONE * simulator->supply : 0.0;
    truth[HIL_TRUTH_SUPPLY] = simulator->supply;
    truth[HIL_TRUTH_WINDING_TEMPERATURE] = simulator->temperature;
    truth[HIL_TRUTH_SLOPE] = ground.slope;
    truth[HIL_TRUTH_LOAD] = body->load;
    truth[HIL_TRUTH_RUT] = body->rut;
    truth[HIL_TRUTH_CARRIAGE_FORCE] = body->carriage_force;
    truth[HIL_TRUTH_SEGMENT] = ground.segment;
    truth[HIL_TRUTH_HEADING] = simulator->heading;
    truth[HIL_TRUTH_PATH_X] = simulator->path[0];
    truth[HIL_TRUTH_PATH_Y] = simulator->path[1];
    truth[HIL_TRUTH_SINKAGE] = body->sinkage;
    truth[HIL_TRUTH_DUG] = body->dug;
}

static void steer(hil_simulator *simulator, double travelled) {
    const hil_profile *steering = &simulator->config.steering;
    const double before = simulator->heading;
    if (steering->count == 0) { /* straight on: what hil_heading_advance gives at heading 0 */
        simulator->path[0] += travelled;
        return;
    }
    simulator->heading = profile_at(steering, now(simulator) + TICK);
    hil_heading_advance(travelled, before, simulator->heading, simulator->path);
}

void hil_sense(hil_simulator *simulator, hil_record *record) {
    const hil_config *config = &simulator->config;
    const hil_body *body = &simulator->body;
    write_truth(simulator, record->truth);
    record->host_count = 0;
    record->answer_count = 0;
    const double values[HIL_CHANNELS] = {
        body->current,
        simulator->supply,
        simulator->temperature,
        simulator->derived.gear * body->position[HIL_ALPHA],
        (body->position[HIL_X] - config->start_position) / config->wheel_radius,
        body->position[HIL_ALPHA] - body->position[HIL_BETA],
        body->rate[HIL_ALPHA] - body->rate[HIL_BETA],
        record->truth[HIL_TRUTH_SLOPE],
        body->rate[HIL_X],
    };
    hil_sensors_push(&simulator->sensors, values);
    simulator->silent = failing(simulator, HIL_FAULT_LINK_SILENCE, -1);
    record->silent = simulator->silent;
    if (simulator->silent) {
        return;
    }
    record->commands = simulator->commands;
    simulator->inputs.tick = simulator->tick;
    simulator->inputs.command_fresh = false;
    read_fast(simulator);
    if (simulator->tick % HIL_COMMAND_TICKS != 0U) {
        read_slow(simulator);
    } else {
        read_command(simulator);
    }
    record->inputs = simulator->inputs;
}

static void warm(hil_simulator *simulator) {
    const hil_winding *winding = &simulator->config.winding;
    if (winding->profile.count > 0) {
        simulator->temperature = profile_at(&winding->profile, now(simulator));
        return;
    }
    const double current = simulator->body.current;
    const double loss = current * current * simulator->around.drive.armature_resistance;
    const double out = (simulator->temperature - winding->ambient) / winding->to_ambient;
    simulator->temperature += TICK * (loss - out) / winding->heat_capacity;
}

/* Frictions stop shell and body exactly; the axle, where nothing but the contact holds it, comes to rest by and by. */
static bool stands(const hil_body *body) {
    return fabs(body->rate[HIL_X]) < 1e-9 && body->rate[HIL_BETA] == 0.0 && body->rate[HIL_ALPHA] == 0.0;
}

/* The tick from `start` on [s], in the plant's own steps; the mean torque on the shell at the contact [N m]. */
static double roll(hil_simulator *simulator, double start) {
    const hil_config *config = &simulator->config;
    hil_surroundings *around = &simulator->around;
    hil_body *body = &simulator->body;
    const double fastest = larger(fabs(config->robot.radius * body->rate[HIL_BETA]), fabs(body->rate[HIL_X]));
    const int steps = fastest < config->fine_below ? config->fine_substeps : config->substeps;
    const double dt = TICK / steps;
    const bool standing = stands(body) && config->carriage.count == 0;
    double torque = 0.0;
    int taken = 0;
    /* What stands still under constant forces does so in the next step as well: one step then says it for the tick. */
    while (taken < steps && !(taken == 1 && standing && stands(body))) {
        around->time = start + taken * dt;
        around->carried = carried(&config->carriage, around->time + dt);
        if (around->carried) {
            around->carriage_speed = profile_at(&config->carriage, around->time + dt);
        }
        hil_body_step(&config->robot, &simulator->derived, &config->path, &config->effects, around, dt, body);
        torque += body->friction[HIL_BETA] + config->robot.radius * body->traction + body->ground_torque;
        taken++;
    }
    return torque / taken;
}

void hil_act(hil_simulator *simulator, int16_t duty, bool enabled) {
    const hil_config *config = &simulator->config;
    hil_surroundings *around = &simulator->around;
    hil_body *body = &simulator->body;
    simulator->duty = duty;
    simulator->enabled = enabled;
    const double start = now(simulator);
    const hil_fault *supply = active(simulator, HIL_FAULT_SUPPLY, -1);
    around->drive.enabled = enabled;
    around->drive.duty = (double)duty / DUTY_ONE;
    around->drive.supply = supply != NULL ? supply->value : config->supply;
    around->drive.supply_resistance = config->supply_resistance;
    around->drive.torque_constant = config->robot.torque_constant;
    const double warmer = simulator->temperature - (double)TERRAPIN_REFERENCE_TEMPERATURE;
    around->drive.armature_resistance =
        config->robot.armature_resistance * (1.0 + config->robot.resistance_slope * warmer);
    around->temperature = simulator->temperature;
    around->pass = config->pass;
    around->moisture = config->moisture;
    around->tow = config->tow.count > 0 ? profile_at(&config->tow, start) : 0.0;

    const double position = body->position[HIL_X];
    if (simulator->plant != NULL) {
        simulator->plant(simulator->context, enabled ? around->drive.duty * around->drive.supply : 0.0, enabled, body);
        simulator->contact_torque = body->friction[HIL_BETA];
    } else {
        simulator->contact_torque = roll(simulator, start);
    }
    simulator->supply =
        around->drive.supply - (enabled ? config->supply_resistance * around->drive.duty * body->current : 0.0);
    warm(simulator);
    steer(simulator, body->position[HIL_X] - position);
    simulator->tick++;
}

void hil_move(hil_simulator *simulator, int16_t duty, bool enabled, uint32_t ticks, hil_record *records) {
    for (uint32_t i = 0; i < ticks; i++) {
        hil_sense(simulator, &records[i]);
        hil_act(simulator, duty, enabled);
    }
}

int hil_answer(hil_simulator *simulator, const hil_record *record) {
    if (simulator->silent) {
        hil_act(simulator, simulator->duty, simulator->enabled);
        return HIL_ANSWERED;
    }
    terrapin_actuate_t actuate;
    if (record->answer_count == 0 || !terrapin_decode_actuate(&record->answer[0], &actuate)) {
        return HIL_NO_ACTUATE;
    }
    uint8_t any = TERRAPIN_E2E_NO_COUNTER;
    if (terrapin_e2e_check(&record->answer[0], &any) != TERRAPIN_E2E_OK) {
        return HIL_BAD_CRC;
    }
    if ((uint32_t)actuate.tick != (simulator->tick & 0xFFFFU)) {
        return HIL_WRONG_TICK;
    }
    hil_act(simulator, (int16_t)actuate.duty, actuate.enable != 0);
    return HIL_ANSWERED;
}

void hil_run(hil_simulator *simulator, hil_step step, void *state, uint32_t ticks, hil_record *records) {
    for (uint32_t i = 0; i < ticks; i++) {
        hil_record *record = &records[i];
        hil_sense(simulator, record);
        if (simulator->silent) {
            hil_act(simulator, simulator->duty, simulator->enabled);
            continue;
        }
        terrapin_outputs out;
        step(state, &simulator->inputs, &out);
        record->answer_count = out.frame_count;
        memcpy(record->answer, out.frames, sizeof out.frames);
        hil_act(simulator, out.duty_q15, out.enable);
    }
}
