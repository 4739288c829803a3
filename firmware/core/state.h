/* What the controller remembers from tick to tick. Private to the core.
 *
 * Units stand last in names; formats that are not plain integers of a unit say so: _q16 is 65536 times the unit.
 * Ranges: speeds, torques and voltages are held within 2^30 of their unit (1074 rad/s, 1074 m/s, 1074 N m, 1074 V)
 * where they are made, so that sums and differences of two fit an int32_t.
 */
#ifndef TERRAPIN_STATE_H
#define TERRAPIN_STATE_H

#include "integer.h"
#include "terrapin_interface.h"

enum {
    SLOT_MS = 10,                         /* telemetry cycle */
    RECORD_MS = TERRAPIN_RECORD_INTERVAL, /* between records; the estimator works out a window at each (schedule.c) */
    WINDOW_MAX_SLOTS = 60,                /* records of the longest window, the range of parameter window */
    BLOCK_SLOTS = 20,                     /* positions are averaged over this many records at a window's ends */
    SWING_SLOTS = 10,                     /* swing rates over this many: a third of a swing period */
    HISTORY_SLOTS = 144,                  /* at least 2 * WINDOW_MAX_SLOTS + BLOCK_SLOTS + 1 */
    FAST_TICKS = 128,                     /* a power of two above the range of parameter slip_window */
    SPEED_TICKS = 20,                     /* window of the drive wheel's speed that the drive uses */
    JUMP_TICKS = 8,                       /* between the two windows in which the ground wheel's speeds are compared */
    DOUBT_TICKS = 500,                    /* that a doubted ground wheel must agree with the shell for */
    TRIM_TICKS = 128,                     /* ticks with the bridge off that make one zero of the current */
    TRIM_RISE = 32,                       /* the current limit's trim gains 1/32 of an excess a tick */
    CALIBRATE_WINDOWS = 3,                /* disjoint valid windows averaged at each calibration speed */
    SENSED_FAULTS = 7,
    FIT_WINDOWS = 64, /* memory of the terrain fit, a power of two */
    FIT_STEPS = 3     /* of taking in a window, one a tick */
};
enum { TERRAINS = TERRAPIN_TERRAIN_HARD_FLOOR }; /* entries of the table of terrains, of which the hard floor is last */

_Static_assert(((RECORD_MS % SLOT_MS) == 0) && (RECORD_MS <= 60), "the products of gains.c fit 32 bits");
_Static_assert(HISTORY_SLOTS > (2 * WINDOW_MAX_SLOTS) + BLOCK_SLOTS, "the history holds two windows and a block");

/* Derived from the parameters whenever one changes, so that no tick divides by them. */
typedef struct {
    int32_t count_e5_urad;    /* alpha of one motor count in 1e-5 urad; below 2^29 */
    int32_t ground_e5_um;     /* way of one count of the ground wheel in 1e-5 um; below 2^26 */
    int32_t turn_per_count;   /* shell's angle of one motor count, one turn = 2^32; below 2^22 */
    int32_t current_gain_q16; /* G_I: uN m of C_t for one code in one sample of the window; below 1.7e9 */
    int32_t speed_gain_q16;   /* G_w: uN m of C_o for one count over the window; at most 2.1e8 */
    int32_t torque_unm_per_a; /* (R/r) K_t; also back-EMF in uV for one rad/s of alpha; at most 5e8 */
    int32_t weight_unm;       /* R W; 1e4 to 2.5e8 */
    int32_t span_mv;          /* R_e times current_limit: within the supply, what the motor's model allows */
    uint32_t window_slots;    /* 10 to WINDOW_MAX_SLOTS */
    bool consistent;          /* no two parameters contradict each other */
    int32_t zero_q8;          /* of the current's code, before it is trimmed */
    bool compensated;         /* some comp_ parameter of the friction is not zero */
    /* the budget of the sd of C_t [uN m], each held within 5e8 */
    uint64_t fixed_variance; /* (uN m)^2 */
    int32_t trimmed_unm;     /* of the current's zero when it is trimmed, */
    int32_t untrimmed_unm;   /* and when not */
    int32_t floor_unm;       /* when calibrated */
    int32_t gain_q30;        /* relative sd of what a wrong gain scales; below 0.6 */
    /* factors of a window's results */
    integer_gain half_urad;    /* half the angle of alpha [urad] of counts */
    integer_gain way_um;       /* way of counts of the ground wheel [um] */
    int32_t current_q32;       /* 10 uA of the window's sum; at most 0.02 */
    int32_t recent_q28;        /* uA of the last slot's sum; at most 2 */
    int32_t voltage_q32;       /* mV of the window's sum; at most 0.01 */
    int32_t acceleration_q19;  /* urad/s^2 of counts; at most 2700 */
    int32_t swing_q20;         /* Q12 of a window's mean of rates, 0.01 rad/s over SWING_SLOTS; at most 4.1 */
    int32_t per_weight_q24;    /* 1e-6 of the weight's torque of one uN m; at most 100 */
    int32_t slope_q24;         /* comp_slope; within 10 */
    int32_t wheel_q22;         /* R/r; at most 250 */
    int32_t heat_q24;          /* comp_heating: Q20 of one mK; within 11 */
    int32_t driving_q20;       /* gear_efficiency; at most 1 */
    int32_t driven_q20;        /* one over driven_efficiency; at most 10 */
    int32_t stribeck_q16;      /* Q16 of one mrad/s over comp_stribeck_speed; at most 6554 */
    int32_t speed_squared_q24; /* uN m of (mrad/s)^2 / 1024; within 103 */
    int32_t comp_viscous_q32;  /* uN m of one urad/s; within 0.1 */
    int32_t comp_inertia_q30;  /* uN m of one urad/s^2; within 1 */
    int32_t sd_viscous_q32;    /* uN m of one urad/s; at most 0.1 */
    int32_t inertia_q30;       /* uN m of one urad/s^2; at most 1 */
    int32_t weight_q22;        /* uN m of 1e-6 of the weight's torque; at most 250 */
} terrapin_gains;

/* Derived as well: factors of what every tick works out. Their formats hold every parameter in its range. */
typedef struct {
    integer_gain motor_speed;   /* alpha_dot [urad/s] of counts in SPEED_TICKS, */
    integer_gain motor_fast;    /* and in slip_window; */
    integer_gain ground_fast;   /* the ground's speed [um/s] there, */
    integer_gain swing_fast;    /* and phi_dot [urad/s] of its sum */
    integer_gain motor_window;  /* alpha_dot of counts in the window, */
    integer_gain ground_window; /* and the ground's speed */
    integer_gain shell_per_rim; /* shell speed [urad/s] of a rim speed [mm/s] */
    integer_wide emf;           /* uV of one urad/s of alpha, uN m of one uA; at most 500 */
    int32_t rim_q32;            /* um/s of one urad/s of the shell; at most 0.5 */
    int32_t shell_q24;          /* urad/s of the shell of one um/s of its rim; at most 100 */
    int32_t per_grip_q26;       /* 1 / (1 - slip_limit); at most 10 */
    int32_t keep_q30;           /* 1 - slip_limit */
    int32_t drop_q32;           /* mV of one uA in the armature; at most 0.1 */
    int32_t rise_q20;           /* what the current limit's trim gains [mV] of one mA too much; at most 3.2 */
    int32_t speed_kp_q26;       /* uV of one urad/s; at most 20 */
    int32_t speed_ki_q32;       /* uV a tick of one urad/s; at most 0.1 */
    int32_t slip_kp_q26;
    int32_t slip_ki_q32;
    int32_t dead_urad_s;   /* slip_dead_band */
    int32_t margin_counts; /* extricate_margin, of the ground wheel */
    uint32_t jump_counts;  /* of the ground wheel, in JUMP_TICKS: by more than this no robot changes its speed */
} terrapin_rates;

/* The sensors in engineering units. */
typedef struct {
    uint32_t tick;        /* last tick seen */
    bool started;         /* a tick was seen */
    uint16_t motor_count; /* as last read */
    uint16_t ground_count;
    int32_t motor_step;      /* counts since the last tick */
    uint32_t motor_position; /* counts since reset, wraps at 2^32 */
    uint32_t ground_position;
    int32_t current_code;
    int32_t current_ua;        /* zero taken off; within 21 A */
    int32_t supply_q8_mv;      /* filtered, 256 = 1 mV; 0 until the first sample */
    int32_t temperature_q8_mc; /* filtered, 256 = 1 mdegC; within 2^30 */
    bool temperature_known;
    int32_t trim_q8_codes; /* measured zero of the current less current_zero_code; within 16 codes */
    bool trimmed;
    uint32_t trim_sum_codes; /* of the block that is being averaged */
    uint16_t trim_count;
    uint16_t off_ticks;                  /* ticks since the bridge went off, stops at 1000 */
    uint16_t fault_ticks[SENSED_FAULTS]; /* how long each cause has lasted, from over_current to over_temperature */
    uint32_t causes;                     /* of the last tick, one bit each from over_current on */
    uint16_t encoder_quarters;           /* how long encoder and back-EMF have disagreed, in quarters of a tick */
} terrapin_sense;

/* One record of the history, written every RECORD_MS. Sums wrap; only their differences mean something. */
typedef struct {
    uint32_t current_sum_codes;
    uint32_t position_sum_counts;
    uint32_t position_counts;
    uint32_t ground_counts;
    uint32_t swing_sum_centirad_s;
    uint32_t voltage_sum_mv;
} terrapin_slot_record;

typedef struct {
    terrapin_slot_record sum; /* running */
    uint16_t newest;          /* index of the newest record */
    uint16_t slots;           /* records since the history began anew, stops at HISTORY_SLOTS */
    uint16_t swing_ticks;     /* ticks for which the swing was measured without a gap, stops at SWING_TICKS_MAX */
    uint8_t quiet_slots;      /* slots for which the gate has been met, stops at QUIET_SLOTS */
    uint16_t since_fresh;     /* slots since the last disjoint valid window */
    int32_t ripple_unm;       /* mean deviation of the last slot's torque from the window's */
    /* results */
    int32_t motor_unm;    /* (R/r) C_m behind the gear, compensated for what acts on motor or current */
    int32_t friction_unm; /* A sgn + B w */
    int32_t torque_unm;   /* C_t, within the full scale */
    int32_t sd_unm;
    int32_t omega_urad_s; /* mean alpha_dot */
    int32_t acceleration_urad_s2;
    int32_t momentum_unm; /* bound of |delta P|/T_w */
    int32_t current_10ua; /* window mean */
    int32_t recent_ua;    /* mean of the last slot */
    int32_t voltage_mv;   /* window mean */
    /* of the window that is being worked out */
    bool open;        /* its work is under way: it has closed, and the history goes on */
    bool swing_valid; /* what the sensors said as it closed */
    bool pitch_valid;
    int16_t swing_angle_mrad;
    int16_t pitch_mrad;
    int32_t beyond_unm; /* friction inside the robot beyond A sgn + B w */
    bool ready;         /* the history holds a window */
    bool full;          /* the history holds two windows and a block */
    int32_t counts;     /* of the motor */
    int32_t current_q8; /* sum of codes less their zero in 1/256 code */
    bool valid;
    bool saturated;
    bool fresh;    /* this valid window shares no sample with the last fresh one */
    uint8_t index; /* counts fresh windows */
} terrapin_estimator;

typedef struct {
    int32_t weight_q8; /* number of windows, forgetting; at most 64 */
    int32_t x_q8;      /* mean of omega^2 in 0.01 rad^2/s^2; below 2^26 */
    int32_t y_q8;      /* mean of f_r in 1e-6; below 2^29 */
    int64_t xx;        /* second moments about the means, in 64 times the product of the units */
    int64_t xy;
    uint8_t windows;
    uint8_t todo;       /* steps that are left for the last fresh window, of FIT_STEPS */
    int32_t square_q25; /* the window's speed squared, in Q25 of 1000 rad^2/s^2 */
    /* results */
    int32_t f_r_ppm;
    int32_t f_r_sd_ppm;
    int32_t terrain;        /* enum terrain */
    int32_t fitted_terrain; /* that the fit belongs to */
    int32_t margin_q3;      /* in 1/8 sd */
    int32_t f_o_10ppm;
    int32_t f_o_sd_ppm;
    int32_t f_s_e7; /* 1e-7 s^2/rad^2 */
    int32_t f_s_sd_e7;
} terrapin_ground_fit;

/* The last FAST_TICKS ticks. */
typedef struct {
    uint16_t motor_counts[FAST_TICKS];
    uint16_t ground_counts[FAST_TICKS];
    uint32_t swing_sum_centirad_s[FAST_TICKS];
} terrapin_fast_history;

typedef struct {
    uint32_t swing_sum_centirad_s; /* running */
    uint16_t ticks;                /* filled, stops at FAST_TICKS */
    uint8_t newest;
    /* results */
    int32_t wheel_urad_s; /* alpha_dot over SPEED_TICKS */
    int32_t emf_uv;       /* back-EMF at wheel_urad_s */
    int32_t shell_urad_s; /* alpha_dot - phi_dot over slip_window, or alpha_dot over window */
    int32_t ground_um_s;
    int32_t slip_e4; /* 1e-4; within 4 */
    bool valid;
    bool slow;        /* over a whole swing period: no swing sensor */
    bool external;    /* ground speed from outside */
    bool implausible; /* the two ground speeds disagree */
    uint16_t disagree_ticks;
    bool moving;          /* slip is defined */
    uint16_t doubt_ticks; /* 0: the ground wheel is believed; else how long it must yet agree with the shell */
    int32_t peak_e4;      /* largest since the last request */
} terrapin_slip_state;

typedef enum { DEMAND_OFF = 0, DEMAND_VOLTAGE = 1, DEMAND_SPEED = 2 } terrapin_demand_mode;

/* What the supervisor wants of the drive. */
typedef struct {
    terrapin_demand_mode mode;
    int32_t voltage_mv;
    int32_t speed_urad_s; /* of the shell */
    bool limiter;
} terrapin_demand;

typedef struct {
    int32_t reference_urad_s; /* speed loop, after the slew limit */
    int32_t speed_integral_uv;
    int32_t limiter_integral_uv;
    bool limiting;
    int32_t limiter_direction;
    bool current_limiting;
    int32_t trim_mv;    /* what the current limit takes off beyond its model of the motor */
    int32_t applied_mv; /* at the motor since the last tick */
    int16_t duty_q15;
    bool enable;
} terrapin_drive;

typedef enum { PHASE_FIRST = 0, PHASE_SECOND = 1, PHASE_HALT = 2 } terrapin_phase;

typedef struct {
    int32_t state;         /* enum state of controller.toml */
    terrapin_phase phase;  /* within calibrate, run and extricate */
    uint32_t timer_ms;     /* in this state and phase */
    uint32_t still_ms;     /* how long nothing has moved */
    uint32_t command_tick; /* of the last fresh command */
    int32_t request;       /* the last fresh command: enum request, */
    int32_t control;       /* enum control, */
    int32_t setpoint;      /* mV or mm/s, */
    bool limiter;          /* and whether the slip limiter is wanted */
    bool refused;          /* a RUN or CALIBRATE, in hold_ms */
    uint32_t hold_ms;      /* how long an IDLE still holds against RUN and CALIBRATE; after a clear it stands still */
    uint8_t blind_ms;      /* how long the guard of the swing has had no sensor, up to BLIND_MS */
    int32_t request_taken; /* the request that is being served or was: it must change before it counts again */
    uint32_t faults;
    uint32_t overrun_ms; /* how long the flag still stands */
    uint32_t no_progress_ms;
    uint32_t episode_ms;        /* since the request, then since stuck */
    uint32_t dig_ground_counts; /* position of the ground wheel where slip passed its limit */
    uint32_t back_motor_counts; /* position of the motor where backing out began */
    bool digging;
    bool moved;         /* since the request */
    bool borne_out;     /* slip passed its limit, and the motor's current had risen with it; backing out goes well */
    int32_t rolling_ua; /* current along the motion while slip was small, low-passed; 0: it never was */
    int32_t direction;  /* of the drive when it got stuck: -1 or 1 */
    int32_t stuck_pitch_mrad;
    int32_t report; /* enum report */
    uint8_t report_number;
    int32_t report_distance_mm;
    int32_t report_duration_10ms;
} terrapin_supervisor;

/* What is left to do when all speeds are measured, in this order. */
enum {
    FIT_NONE = 0,
    FIT_SUMS = 1,
    FIT_VISCOUS = 2,
    FIT_COULOMB = 3,
    FIT_RESIDUAL = 4,
    FIT_TAKE = 5,
    FIT_DONE = 6,
    FIT_FAILED = 7
};

typedef struct {
    int64_t spread; /* of the line through the speeds: its slope is common over spread */
    int64_t common;
    uint8_t step;
    uint8_t windows;
    uint8_t seen;       /* estimator.index of the last window taken */
    uint8_t fit;        /* of the line through the speeds */
    int32_t sum_mrad_s; /* of the speeds that are fitted, */
    int32_t sum_unm;    /* and of their torques */
    int32_t viscous_e8; /* its result */
    int32_t coulomb_unm;
    uint32_t timer_ms;        /* at this speed */
    int32_t omega_sum_urad_s; /* along the motion */
    int32_t torque_sum_unm;
    int32_t omega_mrad_s[TERRAPIN_LIMIT_CALIBRATE_SPEEDS];
    int32_t torque_unm[TERRAPIN_LIMIT_CALIBRATE_SPEEDS]; /* motor's less the floor's: A + B omega */
    int32_t residual_unm;
} terrapin_calibration_state;

/* Where the path has led on the plane. */
typedef struct {
    uint32_t ground_position; /* counts when last looked */
    uint16_t turn;            /* heading then */
    bool known;               /* both are */
    int32_t x_um;             /* within 520 m */
    int32_t y_um;
} terrapin_heading;

struct terrapin_state {
    terrapin_slip_state slip;
    terrapin_supervisor supervisor;
    terrapin_drive drive;
    terrapin_sense sense;
    terrapin_gains gains;
    int32_t parameter[TERRAPIN_PARAMETER_COUNT];
    terrapin_estimator estimator;
    terrapin_ground_fit ground;
    terrapin_calibration_state calibration;
    terrapin_heading heading;
    uint8_t counter;      /* of ACTUATE */
    bool saturated;       /* a telemetry signal of the running cycle did not fit */
    bool saturated_shown; /* of the last whole cycle */
    terrapin_rates rates;
    /* long arrays last: what lies near is read with fewer instructions */
    terrapin_fast_history fast;
    terrapin_slot_record history[HISTORY_SLOTS];
};

#endif
