/* The ground from C_t: f_r = C_t/(R W), the nearest terrain of the table, and f_r = f_o + f_s omega^2 fitted over the
 * windows of one terrain.
 *
 * The fit is recursive least squares in information form: five sums that forget with a memory of FIT_WINDOWS windows.
 * A prior on f_s keeps its covariance bounded while the speed has not varied; forgetting keeps the gain from vanishing.
 */
#include "core.h"

enum {
    PPM = 1000000,
    X_MAX = 131072,            /* omega^2 up to 36 rad/s squared, in 0.01 rad^2/s^2 */
    Y_MAX = 1048576,           /* f_r up to 1.05, in 1e-6 */
    UNKNOWN_Q3 = 64,           /* farther than 8 sd from every curve is no terrain of the table */
    MARGIN_MAX_Q3 = 255,
    FIT_NOISE_PPM = 1000,      /* sd of f_r over windows that the prior is weighed against */
    FIT_PRIOR = 10000,         /* f_s is 0 +- 1e-3 s^2/rad^2, ten of the slope's units: (FIT_NOISE_PPM / 10)^2 */
    WINDOWS_MAX = 127
};

_Static_assert(TERRAPIN_PARAMETER_TERRAIN_HARD_FLOOR_F_S ==
                   (TERRAPIN_PARAMETER_TERRAIN_SAND_F_O + (2 * TERRAINS) - 1),
               "the table of terrains stands in the parameters as pairs, in the order of enum terrain");

static int32_t omega_squared(int32_t omega_urad_s) {
    const int64_t mrad = omega_urad_s / 1000;
    return integer_saturate((mrad * mrad) / 10000); /* 0.01 rad^2/s^2 */
}

int32_t ground_curve_ppm(const terrapin_state *state, uint32_t terrain, int32_t omega_urad_s) {
    const int32_t *pair = &state->parameter[TERRAPIN_PARAMETER_TERRAIN_SAND_F_O + (2 * ((int32_t)terrain - 1))];
    /* 1e-9 * 0.01: at most 1e7 * 2^31 */
    return integer_saturate(pair[0] + integer_divide((int64_t)pair[1] * omega_squared(omega_urad_s), 100000));
}

/* f_r and its sd, the slope's share of W taken out where comp_slope asks for it. */
static void resistance(terrapin_state *state, const terrapin_inputs *inputs) {
    const terrapin_estimator *e = &state->estimator;
    terrapin_ground_fit *ground = &state->ground;
    int64_t torque = e->torque_unm;
    int64_t load = state->gains.weight_unm;
    if (inputs->pitch_valid) {
        const uint32_t turn = integer_turn(inputs->pitch_mrad);
        const int64_t along = integer_shift(load * integer_sine(turn), 15U); /* below 2^28 */
        torque -= (along * state->parameter[TERRAPIN_PARAMETER_COMP_SLOPE]) / 10000;
        load = integer_shift(load * integer_clamp(integer_cosine(turn), 8192, 32767), 15U); /* down to a quarter: no zero */
    }
    const int64_t sign = (e->omega_urad_s < 0) ? -1 : 1;
    ground->f_r_ppm = integer_clamp((sign * torque * PPM) / load, -Y_MAX, Y_MAX);
    ground->f_r_sd_ppm = integer_clamp(((int64_t)e->sd_unm * PPM) / load, 1, Y_MAX);
}

static void nearest(terrapin_state *state) {
    terrapin_ground_fit *ground = &state->ground;
    const int64_t own = ground->f_r_sd_ppm;
    const int64_t spread = state->parameter[TERRAPIN_PARAMETER_SD_TERRAIN];
    const int64_t sd = integer_root((uint64_t)((own * own) + (spread * spread))); /* at least 1 */
    int64_t first = INT32_MAX;
    int64_t second = INT32_MAX;
    ground->terrain = TERRAPIN_TERRAIN_UNKNOWN;
    for (uint32_t i = 1U; i <= (uint32_t)TERRAINS; i++) {
        const int64_t off = (int64_t)ground->f_r_ppm - ground_curve_ppm(state, i, state->estimator.omega_urad_s);
        const int64_t distance_q3 = (integer_abs(off) * 8) / sd;
        if (distance_q3 < first) {
            second = first;
            first = distance_q3;
            ground->terrain = (uint8_t)i;
        } else if (distance_q3 < second) {
            second = distance_q3;
        } else {
            /* neither */
        }
    }
    if (first > UNKNOWN_Q3) {
        ground->terrain = TERRAPIN_TERRAIN_UNKNOWN;
    }
    ground->margin_q3 = integer_clamp(second - first, 0, MARGIN_MAX_Q3);
}

static void fit_begin(terrapin_ground_fit *ground) {
    ground->weight_q6 = 0;
    ground->x_q6 = 0;
    ground->xx_q6 = 0;
    ground->y_q6 = 0;
    ground->xy_q6 = 0;
    ground->windows = 0U;
    ground->fitted_terrain = ground->terrain;
}

/* One term of a sum that forgets. */
static void gather(int64_t *sum_q6, int64_t value) {
    *sum_q6 += (value * 64) - (*sum_q6 / FIT_WINDOWS);
}

static void fit_add(terrapin_state *state) {
    terrapin_ground_fit *ground = &state->ground;
    const int64_t x = integer_clamp(omega_squared(state->estimator.omega_urad_s), 0, X_MAX);
    const int64_t y = ground->f_r_ppm; /* within Y_MAX */
    gather(&ground->weight_q6, 1);
    gather(&ground->x_q6, x);
    gather(&ground->xx_q6, x * x);
    gather(&ground->y_q6, y);
    gather(&ground->xy_q6, x * y);
    if (ground->windows < WINDOWS_MAX) {
        ground->windows++;
    }
}

/* Sums are at most FIT_WINDOWS * 64 = 4096 times their largest term: xx below 2^46, xy below 2^49. */
static void fit_solve(terrapin_ground_fit *ground) {
    const int64_t weight = ground->weight_q6; /* at least 64 */
    const int64_t x_mean = integer_divide(ground->x_q6, weight);
    const int64_t y_mean = integer_divide(ground->y_q6, weight);
    const int64_t sxx = (ground->xx_q6 - (2 * x_mean * ground->x_q6)) + (x_mean * x_mean * weight);
    const int64_t sxy = ((ground->xy_q6 - (x_mean * ground->y_q6)) - (y_mean * ground->x_q6)) + (x_mean * y_mean * weight);
    const int64_t information = ((sxx > 0) ? (sxx / 64) : 0) + FIT_PRIOR;
    /* slope in 1e-6 a 0.01 rad^2/s^2, that is 1e-4 s^2/rad^2 */
    const int64_t slope_e7 = integer_divide((sxy / 64) * 1000, information);
    ground->f_s_e7 = integer_saturate(slope_e7);
    ground->f_o_10ppm = integer_saturate(integer_divide((y_mean * 1000) - (slope_e7 * x_mean), 10000));
    /* sd of the slope: noise / sqrt(information); of f_o: the mean's and the slope's over x_mean */
    const int64_t root = integer_root((uint64_t)information); /* at least 100 */
    const int64_t slope_sd_e7 = ((int64_t)FIT_NOISE_PPM * 1000) / root;
    const int64_t mean_sd = ((int64_t)FIT_NOISE_PPM * 8) / (int64_t)integer_root((uint64_t)weight);
    const int64_t far_sd = (slope_sd_e7 * x_mean) / 1000;
    ground->f_s_sd_e7 = integer_saturate(slope_sd_e7);
    ground->f_o_sd_ppm = (int32_t)integer_root((uint64_t)((mean_sd * mean_sd) + (far_sd * far_sd)));
}

void ground_update(terrapin_state *state, const terrapin_inputs *inputs) {
    terrapin_ground_fit *ground = &state->ground;
    resistance(state, inputs);
    nearest(state);
    if (state->estimator.fresh) {
        if (ground->terrain != ground->fitted_terrain) {
            fit_begin(ground);
        }
        fit_add(state);
        fit_solve(ground);
    }
}
