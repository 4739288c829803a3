/* The ground from C_t: f_r = C_t/(R W), the nearest terrain of the table, and f_r = f_o + f_s omega^2 fitted over the
 * windows of one terrain.
 *
 * The fit is recursive least squares, centred: means and second moments of x = omega^2 and y = f_r that forget with a
 * memory of FIT_WINDOWS windows. A prior on f_s bounds the covariance while the speed has not varied; forgetting keeps
 * the gain from vanishing.
 */
#include "core.h"

enum {
    X_MAX = 131072,  /* omega^2 up to 36 rad/s squared, in 0.01 rad^2/s^2 */
    Y_MAX = 1048576, /* f_r up to 1.05, in 1e-6 */
    UNKNOWN_Q3 = 64, /* farther than 8 sd from every curve is no terrain of the table */
    MARGIN_MAX_Q3 = 255,
    SQUARE_MOST_Q20 = 41943054, /* 200 rad/s squared, in Q20 of 1000 rad^2/s^2: 32 times it fits */
    FIT_NOISE_PPM = 1000,       /* sd of f_r over windows that the prior is weighed against */
    MOMENT_BITS = 22,           /* moments of Q8 numbers are kept in 64 times the product of their units */
    FIT_PRIOR = 156,            /* f_s is 0 +- 1e-3 s^2/rad^2, ten of the slope's units: (FIT_NOISE_PPM / 10)^2 / 64 */
    WINDOWS_MAX = 127
};

_Static_assert(TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_S == (TERRAPIN_PARAMETER_TERRAIN_SAND_F_O + (2 * TERRAINS) - 1),
               "the table of terrains stands in the parameters as pairs, in the order of enum terrain");

/* 0.01 rad^2/s^2 to the nearest, of any speed. In 32 bits: what 0.1 rad/s leaves of it gives the fraction. */
static int32_t omega_squared(int32_t omega_urad_s) {
    const uint32_t mrad_s = (uint32_t)integer_abs(omega_urad_s / 1000);
    const uint32_t tenths = mrad_s / 100U;
    const uint32_t rest = mrad_s - (tenths * 100U);
    const uint32_t square = (tenths * tenths) + (((((200U * tenths) + rest) * rest) + 5000U) / 10000U);
    return (int32_t)square; /* below 2^29 */
}

/* What the curves take of a speed: its square in Q25 of 1000 rad^2/s^2. Held at 200 rad/s. */
static int32_t square_of(int32_t omega_urad_s) {
    const int32_t square = integer_q_held(omega_squared(omega_urad_s), 1374390, 17U); /* 2^20 / 1e5 is 1374390 / 2^17 */
    return ((square < SQUARE_MOST_Q20) ? square : SQUARE_MOST_Q20) * 32;
}

void ground_speed(terrapin_state *state) {
    state->ground.square_q25 = square_of(state->estimator.omega_urad_s);
}

/* f_o + f_s omega^2 of a pair of parameters [1e-6, 1e-9; |f_s| at most 1e7]: below 1e6 + 40 * 1e7. */
INTEGER_INLINE int32_t curve_ppm(const int32_t *pair, int32_t square_q25) {
    TERRAPIN_ASSERT((square_q25 >= 0) && (integer_abs(pair[1]) <= 10000000));
    return integer_q32_plus(pair[0], pair[1] * 128, square_q25);
}

int32_t ground_floor_unm(const terrapin_state *state, int32_t omega_urad_s) {
    return integer_q_held(
        curve_ppm(&state->parameter[TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_O], square_of(omega_urad_s)),
        state->gains.weight_q22, 22U);
}

/* f_r and its sd, the slope's share of W taken out where comp_slope asks for it. */
void ground_resistance(terrapin_state *state) {
    const terrapin_estimator *e = &state->estimator;
    const terrapin_gains *g = &state->gains;
    terrapin_ground_fit *ground = &state->ground;
    if (!e->open) {
        return;
    }
    int32_t torque = e->torque_unm;
    int32_t secant_q16 = 65536;
    if (e->pitch_valid) {
        const uint32_t turn = integer_turn(e->pitch_mrad);
        const int32_t share = integer_of_sine(g->weight_unm, integer_sine(turn)); /* below 2^28 */
        torque = integer_hold(torque - integer_q_held(share, g->slope_q24, 24U));
        /* of a cosine down to a quarter: no division by zero, whatever the pitch */
        secant_q16 = (32767 * 65536) / integer_clamp(integer_cosine(turn), 8192, 32767);
    }
    TERRAPIN_ASSERT((secant_q16 >= 65536) && (secant_q16 <= 262136));
    const int32_t along = (e->omega_urad_s < 0) ? -torque : torque;
    const int32_t f_r_ppm = integer_q_held(integer_q_held(along, g->per_weight_q24, 24U), secant_q16, 16U);
    const int32_t sd_ppm = integer_q_held(integer_q_held(e->sd_unm, g->per_weight_q24, 24U), secant_q16, 16U);
    ground->f_r_ppm = integer_clamp(f_r_ppm, -Y_MAX, Y_MAX);
    ground->f_r_sd_ppm = integer_clamp(sd_ppm, 1, Y_MAX);
}

/* Distance of f_r from a curve in 1/8 sd. */
static uint32_t eighths(uint32_t off_ppm, uint32_t sd_ppm) {
    TERRAPIN_ASSERT((sd_ppm > 0U) && (sd_ppm <= 0x200000U));
    TERRAPIN_ASSERT(off_ppm <= 402100000U); /* 40 * 1e7, an f_o and an f_r; 8 times it fits 32 bits */
    return ((off_ppm * 8U) + (sd_ppm / 2U)) / sd_ppm;
}

static void nearest(terrapin_state *state) {
    terrapin_ground_fit *ground = &state->ground;
    const int64_t own = ground->f_r_sd_ppm;
    const int64_t spread = state->parameter[TERRAPIN_PARAMETER_SD_TERRAIN];
    const int64_t variance = (own * own) + (spread * spread);
    const uint32_t sd = integer_root((uint64_t)variance); /* 1 to 2^21 */
    const int32_t *pair = &state->parameter[TERRAPIN_PARAMETER_TERRAIN_SAND_F_O];
    uint32_t off[TERRAINS]; /* from each curve; the two least are then told in sd, which keeps their order */
    uint32_t least = UINT32_MAX;
    uint32_t next = UINT32_MAX;
    for (int32_t i = 0; i < TERRAINS; i++) {
        const uint32_t far = (uint32_t)integer_abs(ground->f_r_ppm - curve_ppm(pair, ground->square_q25));
        off[i] = far;
        pair = &pair[2];
        if (far < least) {
            next = least;
            least = far;
        } else {
            next = (far < next) ? far : next;
        }
    }
    const uint32_t first = eighths(least, sd);
    const uint32_t margin = eighths(next, sd) - first;
    ground->margin_q3 = (int32_t)((margin < (uint32_t)MARGIN_MAX_Q3) ? margin : (uint32_t)MARGIN_MAX_Q3);
    ground->terrain = TERRAPIN_TERRAIN_UNKNOWN;
    if (first <= (uint32_t)UNKNOWN_Q3) {
        /* of those that are as near to an eighth of sd, which is rounded, the first in the table */
        const uint32_t beyond = first + 1U;
        const uint32_t near = ((beyond * sd) - (sd / 2U) - 1U) / 8U; /* below 2^25; the least is not above it */
        int32_t terrain = 1;
        while ((terrain < TERRAINS) && (off[terrain - 1] > near)) {
            terrain++;
        }
        ground->terrain = terrain;
    }
}

void ground_nearest(terrapin_state *state) {
    if (state->estimator.open) {
        nearest(state);
        state->ground.todo = state->estimator.fresh ? (uint8_t)FIT_STEPS : 0U;
        state->estimator.open = false;
    }
}

static void fit_begin(terrapin_ground_fit *ground) {
    ground->weight_q8 = 0;
    ground->x_q8 = 0;
    ground->y_q8 = 0;
    ground->xx = 0;
    ground->xy = 0;
    ground->windows = 0U;
    ground->fitted_terrain = ground->terrain;
}

/* A second moment that takes in a product, and forgets. */
static int64_t moment(int64_t sum, int32_t one, int32_t other) {
    return sum + integer_q_held(one, other, MOMENT_BITS) - (sum / FIT_WINDOWS);
}

/* Takes the fresh window in. */
static void fit_add(terrapin_state *state) {
    terrapin_ground_fit *g = &state->ground;
    if (g->terrain != g->fitted_terrain) {
        fit_begin(g);
    }
    g->weight_q8 += 256 - (g->weight_q8 / FIT_WINDOWS); /* 256 to 64 * 256 */
    TERRAPIN_ASSERT((g->weight_q8 >= 256) && (g->weight_q8 <= ((FIT_WINDOWS * 256) + FIT_WINDOWS)));
    const int32_t dx = (integer_clamp(omega_squared(state->estimator.omega_urad_s), 0, X_MAX) * 256) - g->x_q8;
    const int32_t dy = (g->f_r_ppm * 256) - g->y_q8;
    const int32_t step = integer_scale(dx, 256, g->weight_q8);
    g->x_q8 += step;
    g->y_q8 += integer_scale(dy, 256, g->weight_q8);
    /* |dx| < 2^26, |dy| < 2^29: in units of 64 the products fit, and the sums stay below 64 * 2^30 */
    g->xx = moment(g->xx, dx, dx - step);
    g->xy = moment(g->xy, dy, dx - step);
    TERRAPIN_ASSERT(g->xx >= 0);
    if (g->windows < WINDOWS_MAX) {
        g->windows++;
    }
}

static void fit_slope(terrapin_ground_fit *g) {
    TERRAPIN_ASSERT((g->xx >= 0) && (g->xx < integer_power(40U)));
    /* slope in 1e-6 a 0.01 rad^2/s^2, that is 1e-4 s^2/rad^2 */
    g->f_s_e7 = integer_saturate(integer_divide(g->xy * 1000, g->xx + FIT_PRIOR));
    const int32_t far_ppm = integer_scale(g->f_s_e7, g->x_q8, 256000);
    g->f_o_10ppm = integer_ratio((g->y_q8 / 256) - far_ppm, 10);
}

static void fit_deviations(terrapin_ground_fit *g) {
    /* sd of the slope: noise / sqrt(information); of f_o: the mean's and the slope's over the mean of x */
    const int64_t information = g->xx + FIT_PRIOR;
    const int32_t root =
        (int32_t)integer_root((uint64_t)information); /* at least 12; the moments' unit makes it 8 times */
    TERRAPIN_ASSERT(root >= 12);
    g->f_s_sd_e7 = (FIT_NOISE_PPM * 1000) / (8 * root);
    const int64_t mean_sd = (FIT_NOISE_PPM * 16) / (int32_t)integer_root((uint64_t)g->weight_q8);
    const int64_t far_sd = integer_scale(g->f_s_sd_e7, g->x_q8, 256000);
    const int64_t variance = (mean_sd * mean_sd) + (far_sd * far_sd);
    g->f_o_sd_ppm = (int32_t)integer_root((uint64_t)variance);
}

void ground_fit_work(terrapin_state *state) {
    terrapin_ground_fit *g = &state->ground;
    TERRAPIN_ASSERT(g->todo <= (uint8_t)FIT_STEPS);
    if (g->todo == (uint8_t)FIT_STEPS) {
        fit_add(state);
    } else if (g->todo == 2U) {
        fit_slope(g);
    } else if (g->todo == 1U) {
        fit_deviations(g);
    } else {
        /* nothing is left of it */
    }
    g->todo = (g->todo > 0U) ? (uint8_t)(g->todo - 1U) : 0U;
}
