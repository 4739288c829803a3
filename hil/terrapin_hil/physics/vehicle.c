#include "vehicle.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "flow.h"
#include "vehicle_by.h"

enum { FRONT = 0, REAR = 1, AXLES = 2, STATE = HIL_VEHICLE_STATE, SOIL = HIL_VEHICLE_SOIL };

typedef struct {
    double y[STATE];
    double by[STATE][SOIL];
} state;

/* What is kept between calls so that the next contact starts near its solution. */
typedef struct {
    double sinkage;
    double load;
    double slip;
    double by_load;
    double by_slip; /* a secant */
} guess;

/* A contact that was solved, and for what: a neighbour that changes nothing of it takes it over. */
typedef struct {
    hil_tyre tyre;
    hil_tyre_soil soil;
    double load;
    double slip;
    double sinkage;
    hil_tyre_contact contact;
} solved;

typedef struct {
    const hil_vehicle *vehicle;
    const hil_tyre *tyre;
    const hil_tyre_soil *soil;
    double step;
    int columns;
    int contact_columns; /* that each contact is solved with */
    guess guess[AXLES];
    solved *known; /* of each axle, or NULL */
    hil_vehicle_failure *failure;
    const hil_vehicle_effects *effects; /* or NULL */
    int sample;                         /* that this step follows, of effects->input */
    double begin;                       /* of the step: share of the way from this sample to the next */
    double share;                       /* of the present stage */
    double angle[AXLES];                /* of the wheels at the start of the step [rad] */
    double into;                        /* time from there to the present stage [s] */
} run;

/* Parameters of this moment, as effects change them, and what the effects add. */
typedef struct {
    hil_vehicle vehicle;
    hil_tyre tyre;
    hil_tyre_soil soil;
    double torque;  /* of the rear half shaft [N m] */
    double resist;  /* [N] on the car, or [N m] on the wheel */
    double inertia; /* [kg], or [kg m^2] */
} moment;

/* Fills `now` for one axle, or for the car as a whole (axle = AXLES). */
static void evaluate_effects(const run *r, int axle, const state *s, double load, double torque, moment *now) {
    const hil_vehicle_effects *e = r->effects;
    const int car = axle == AXLES;
    const int wheel = car ? REAR : axle;
    double v[HIL_VEHICLE_VALUES];
    memcpy(v, e->values, sizeof(double) * (size_t)e->count);
    for (int i = 0; i < e->inputs; i++) {
        const double *at = &e->input[r->sample * e->inputs + i];
        v[e->slot[i]] = at[0] + r->share * (at[e->inputs] - at[0]);
    }
    const double speed = s->y[HIL_VEHICLE_SPEED];
    const double omega = s->y[HIL_VEHICLE_OMEGA + wheel];
    double by_axle, by_rim;
    v[HIL_ROLE_OMEGA] = omega;
    v[HIL_ROLE_ANGLE] = r->angle[wheel] + r->into * omega;
    v[HIL_ROLE_ACCELERATION] = 0.0;
    v[HIL_ROLE_SPEED] = car ? speed : fmax(fabs(speed), r->vehicle->speed_floor);
    v[HIL_ROLE_SLIP] = hil_tyre_slip(speed, r->tyre->radius * omega, r->vehicle->speed_floor, &by_axle, &by_rim);
    v[HIL_ROLE_LOAD] = load;
    v[HIL_ROLE_PASS] = 2.0 * v[HIL_ROLE_PASS] - (wheel == FRONT ? 1.0 : 0.0);
    v[HIL_ROLE_DRIVE_TORQUE] = torque;
    hil_additions_change(e->additions, 0, v);
    hil_additions_change(e->additions, 1, v);
    now->resist = hil_additions_torque(e->additions, car, v, &now->inertia);
    now->torque = v[HIL_ROLE_DRIVE_TORQUE];
    memcpy(&now->vehicle, &v[HIL_VEHICLE_CAR], sizeof now->vehicle);
    memcpy(&now->tyre, &v[HIL_VEHICLE_TYRE], sizeof now->tyre);
    memcpy(&now->soil, &v[HIL_VEHICLE_GROUND], sizeof now->soil);
    if (car) {
        now->resist /= now->tyre.radius;
        now->inertia /= now->tyre.radius * now->tyre.radius;
    }
}

/* Load of one wheel, and its derivatives by the soil's numbers. */
typedef struct {
    double value;
    double by[SOIL];
} quantity;

static void wheel_loads(const hil_vehicle *v, const state *s, int columns, double resist, quantity *load) {
    const double base = v->front_distance + v->rear_distance;
    const double shift = v->mass * v->height / (2.0 * base);
    const double speed = s->y[HIL_VEHICLE_SPEED];
    const double thrust = 2.0 * (s->y[HIL_VEHICLE_FORCE + FRONT] + s->y[HIL_VEHICLE_FORCE + REAR]);
    const double acceleration = (thrust - v->drag * speed * speed - resist) / v->mass;
    const double arm[AXLES] = {v->rear_distance, v->front_distance};
    for (int axle = 0; axle < AXLES; axle++) {
        const double sign = axle == FRONT ? -1.0 : 1.0;
        const double plain = v->mass * v->gravity * arm[axle] / (2.0 * base) + sign * shift * acceleration;
        const int held = plain < v->load_floor;
        load[axle].value = held ? v->load_floor : plain;
        for (int p = 0; p < SOIL && columns > 1; p++) {
            const double by = 2.0 * (s->by[HIL_VEHICLE_FORCE + FRONT][p] + s->by[HIL_VEHICLE_FORCE + REAR][p]) -
                              2.0 * v->drag * speed * s->by[HIL_VEHICLE_SPEED][p];
            load[axle].by[p] = held ? 0.0 : sign * shift * by / v->mass;
        }
    }
}

static int same_wheel(const solved *known, const hil_tyre *tyre, const hil_tyre_soil *soil) {
    const hil_tyre *t = &known->tyre;
    const hil_tyre_soil *s = &known->soil;
    return t->radius == tyre->radius && t->width == tyre->width && t->stiffness == tyre->stiffness &&
           t->angle_share == tyre->angle_share && t->angle_slip == tyre->angle_slip &&
           s->stiffness == soil->stiffness && s->exponent == soil->exponent && s->cohesion == soil->cohesion &&
           s->friction_angle == soil->friction_angle && s->shear_modulus == soil->shear_modulus;
}

static int contact_of(run *r, int axle, const hil_tyre *tyre, const hil_tyre_soil *soil, double load, double slip,
                      double *sinkage, hil_tyre_contact *c) {
    solved *known = r->known != NULL ? &r->known[axle] : NULL;
    if (known != NULL && load == known->load && slip == known->slip && same_wheel(known, tyre, soil)) {
        *sinkage = known->sinkage;
        *c = known->contact;
        return HIL_TYRE_OK;
    }
    const int status = hil_tyre_equilibrium(tyre, soil, load, slip, r->contact_columns, sinkage, c);
    if (status == HIL_TYRE_OK && known != NULL) {
        *known = (solved){*tyre, *soil, load, slip, *sinkage, *c};
    }
    return status;
}

/* One wheel: derivatives of its omega, F_x and M_y. */
static int wheel(run *r, int axle, const state *s, const quantity *load, const quantity *torque, state *rate) {
    moment now;
    const hil_vehicle *v = r->vehicle;
    const hil_tyre *tyre = r->tyre;
    const hil_tyre_soil *soil = r->soil;
    double resist = 0.0;
    double inertia = 0.0;
    if (r->effects != NULL) {
        evaluate_effects(r, axle, s, load->value, torque->value, &now);
        v = &now.vehicle;
        tyre = &now.tyre;
        soil = &now.soil;
        resist = now.resist;
        inertia = now.inertia;
    }
    const int i_omega = HIL_VEHICLE_OMEGA + axle;
    const int i_force = HIL_VEHICLE_FORCE + axle;
    const int i_torque = HIL_VEHICLE_TORQUE + axle;
    const double speed = s->y[HIL_VEHICLE_SPEED];
    const double omega = s->y[i_omega];
    const double radius = tyre->radius - load->value / (3.0 * tyre->stiffness); /* R_e */
    const double rim = radius * omega;
    guess *g = &r->guess[axle];
    double by_axle, by_rim;
    hil_tyre_contact c;
    const double slip = hil_tyre_slip(speed, rim, v->speed_floor, &by_axle, &by_rim);
    double sinkage = g->sinkage + g->by_load * (load->value - g->load) + g->by_slip * (slip - g->slip);
    r->failure->axle = axle;
    r->failure->load = load->value;
    r->failure->slip = slip;
    const int status = contact_of(r, axle, tyre, soil, load->value, slip, &sinkage, &c);
    if (status != HIL_TYRE_OK) {
        return status;
    }
    const double slope = c.derivative[HIL_TYRE_LOAD][HIL_TYRE_BY_Z];
    if (r->known != NULL && fabs(slip - g->slip) > 1e-9) { /* steps of a controlled length need no guess as near */
        g->by_slip = (sinkage - g->sinkage - (load->value - g->load) / slope) / (slip - g->slip);
    }
    g->sinkage = sinkage;
    g->load = load->value;
    g->slip = slip;
    g->by_load = 1.0 / slope;
    const double fastest = fmax(fmax(fabs(speed), fabs(rim)), v->speed_floor);
    const double quickness = fastest / v->relaxation_length;
    r->failure->longest_step = 0.5 / quickness;
    if (r->step > r->failure->longest_step) {
        return HIL_TYRE_STEP_TOO_LONG;
    }
    const double force_gap = c.value[HIL_TYRE_FORCE] - s->y[i_force];
    const double torque_gap = c.value[HIL_TYRE_TORQUE] - s->y[i_torque];
    rate->y[i_omega] = (torque->value - s->y[i_torque] - resist) / (v->wheel_inertia + inertia);
    rate->y[i_force] = quickness * force_gap;
    rate->y[i_torque] = quickness * torque_gap;
    for (int p = 0; p < SOIL && r->columns > 1; p++) {
        const double deflection_by = load->by[p] / tyre->stiffness;
        const double speed_by = s->by[HIL_VEHICLE_SPEED][p];
        const double rim_by = radius * s->by[i_omega][p] - omega * deflection_by / 3.0;
        const double slip_by = by_axle * speed_by + by_rim * rim_by;
        double steady_by[3];
        for (int k = 0; k < 3; k++) {
            const double *d = c.derivative[k];
            steady_by[k] =
                d[HIL_TYRE_BY_DEFLECTION] * deflection_by + d[HIL_TYRE_BY_SLIP] * slip_by + d[HIL_TYRE_BY_SOIL + p];
        }
        const double sinkage_by = (load->by[p] - steady_by[HIL_TYRE_LOAD]) / slope; /* F_z(z, ...) = load */
        double quickness_by = 0.0;
        if (fastest > v->speed_floor) {
            quickness_by =
                (fabs(rim) >= fabs(speed) ? copysign(rim_by, rim * rim_by) : speed_by) / v->relaxation_length;
        }
        rate->by[i_omega][p] = (torque->by[p] - s->by[i_torque][p]) / v->wheel_inertia;
        rate->by[i_force][p] =
            quickness_by * force_gap +
            quickness * (steady_by[HIL_TYRE_FORCE] + c.derivative[HIL_TYRE_FORCE][HIL_TYRE_BY_Z] * sinkage_by -
                         s->by[i_force][p]);
        rate->by[i_torque][p] =
            quickness_by * torque_gap +
            quickness * (steady_by[HIL_TYRE_TORQUE] + c.derivative[HIL_TYRE_TORQUE][HIL_TYRE_BY_Z] * sinkage_by -
                         s->by[i_torque][p]);
    }
    return HIL_TYRE_OK;
}

static int rates(run *r, const state *s, double measured_torque, state *rate) {
    moment now;
    const hil_vehicle *v = r->vehicle;
    double rear_torque = measured_torque;
    double resist = 0.0;
    double mass = v->mass;
    if (r->effects != NULL) {
        evaluate_effects(r, AXLES, s, v->mass * v->gravity, measured_torque, &now);
        v = &now.vehicle;
        rear_torque = now.torque;
        resist = now.resist;
        mass = v->mass + now.inertia;
    }
    quantity load[AXLES];
    quantity torque[AXLES] = {{0.0, {0.0}}, {rear_torque, {0.0}}};
    wheel_loads(v, s, r->columns, resist, load);
    const double ratio = load[FRONT].value / load[REAR].value;
    torque[FRONT].value = rear_torque * ratio;
    const double speed = s->y[HIL_VEHICLE_SPEED];
    rate->y[HIL_VEHICLE_SPEED] =
        (2.0 * (s->y[HIL_VEHICLE_FORCE + FRONT] + s->y[HIL_VEHICLE_FORCE + REAR]) - v->drag * speed * speed - resist) /
        mass;
    for (int p = 0; p < SOIL && r->columns > 1; p++) {
        torque[FRONT].by[p] = rear_torque * (load[FRONT].by[p] - ratio * load[REAR].by[p]) / load[REAR].value;
        rate->by[HIL_VEHICLE_SPEED][p] =
            (2.0 * (s->by[HIL_VEHICLE_FORCE + FRONT][p] + s->by[HIL_VEHICLE_FORCE + REAR][p]) -
             2.0 * v->drag * speed * s->by[HIL_VEHICLE_SPEED][p]) /
            v->mass;
    }
    for (int axle = 0; axle < AXLES; axle++) {
        const int status = wheel(r, axle, s, &load[axle], &torque[axle], rate);
        if (status != HIL_TYRE_OK) {
            return status;
        }
    }
    return HIL_TYRE_OK;
}

/* result = base + h * rate */
static void advance(const state *base, const state *rate, double h, int columns, state *result) {
    for (int i = 0; i < STATE; i++) {
        result->y[i] = base->y[i] + h * rate->y[i];
        for (int p = 0; p < SOIL && columns > 1; p++) {
            result->by[i][p] = base->by[i][p] + h * rate->by[i][p];
        }
    }
}

/* One RK4 step with the torque at its start, middle and end. */
static int step(run *r, const double *torque, state *s) {
    const double h = r->step;
    const double width = r->share - r->begin;
    const double omega[AXLES] = {s->y[HIL_VEHICLE_OMEGA + FRONT], s->y[HIL_VEHICLE_OMEGA + REAR]};
    state k[4], at;
    r->share = r->begin;
    r->into = 0.0;
    int status = rates(r, s, torque[0], &k[0]);
    for (int stage = 1; stage < 4 && status == HIL_TYRE_OK; stage++) {
        advance(s, &k[stage - 1], stage == 3 ? h : 0.5 * h, r->columns, &at);
        r->share = r->begin + (stage == 3 ? 1.0 : 0.5) * width;
        r->into = stage == 3 ? h : 0.5 * h;
        status = rates(r, &at, torque[stage == 3 ? 2 : 1], &k[stage]);
    }
    if (status != HIL_TYRE_OK) {
        return status;
    }
    for (int stage = 0; stage < 4; stage++) {
        advance(s, &k[stage], stage == 0 || stage == 3 ? h / 6.0 : h / 3.0, r->columns, s);
    }
    for (int i = HIL_VEHICLE_SPEED; i < HIL_VEHICLE_FORCE; i++) {
        if (s->y[i] < 0.0) {
            s->y[i] = 0.0;
            memset(s->by[i], 0, sizeof s->by[i]);
        }
    }
    for (int axle = 0; axle < AXLES; axle++) {
        r->angle[axle] += 0.5 * h * (omega[axle] + s->y[HIL_VEHICLE_OMEGA + axle]);
    }
    return HIL_TYRE_OK;
}

static void note(const run *r, const state *s, ptrdiff_t sample, double *record, double *sensitivity) {
    double *row = &record[sample * HIL_VEHICLE_RECORD];
    memcpy(row, s->y, sizeof s->y);
    for (int axle = 0; axle < AXLES; axle++) {
        row[HIL_VEHICLE_SINKAGE + axle] = r->guess[axle].sinkage;
    }
    if (sensitivity != NULL) {
        double *rows = &sensitivity[sample * HIL_VEHICLE_RECORD * SOIL];
        memset(rows, 0, sizeof(double) * HIL_VEHICLE_RECORD * SOIL);
        memcpy(rows, s->by, sizeof s->by);
    }
}

/* Longest step that resolves the wheel's swing against the relaxed torque at standstill, J w'' + J q w' + M' w = 0 with
 * M' = q dM/domega = dM/di R_e / lambda [N m]: half its time 1/sqrt(M'/J). The slip torque is steepest at i = 0. */
static int swing_limit(run *r, const state *s) {
    const hil_vehicle *v = r->vehicle;
    quantity load[AXLES];
    wheel_loads(v, s, 1, 0.0, load);
    for (int axle = 0; axle < AXLES; axle++) {
        hil_tyre_contact c;
        double sinkage = r->guess[axle].sinkage;
        r->failure->axle = axle;
        r->failure->load = load[axle].value;
        r->failure->slip = 0.0;
        const int status =
            hil_tyre_equilibrium(r->tyre, r->soil, load[axle].value, 0.0, HIL_TYRE_COLUMNS, &sinkage, &c);
        if (status != HIL_TYRE_OK) {
            return status;
        }
        const double by_slip = fabs(c.derivative[HIL_TYRE_TORQUE][HIL_TYRE_BY_SLIP]);
        r->failure->longest_step = 0.5 * sqrt(v->wheel_inertia * v->relaxation_length / (by_slip * c.effective_radius));
        if (r->step > r->failure->longest_step) {
            return HIL_TYRE_STEP_TOO_LONG;
        }
    }
    return HIL_TYRE_OK;
}

int hil_vehicle_run(const hil_vehicle *vehicle, const hil_tyre *tyre, const hil_tyre_soil *soil, int samples,
                    double period, int substeps, const double *torque, double start, const hil_vehicle_effects *effects,
                    double *record, double *sensitivity, hil_vehicle_failure *failure) {
    assert(effects == NULL || (sensitivity == NULL && effects->count <= HIL_VEHICLE_VALUES));
    const guess first = {0.05, 0.0, 0.0, 0.0, 0.0};
    run r;
    memset(&r, 0, sizeof r);
    r.vehicle = vehicle;
    r.tyre = tyre;
    r.soil = soil;
    r.step = period / substeps;
    r.columns = r.contact_columns = sensitivity == NULL ? 1 : HIL_TYRE_COLUMNS;
    r.guess[FRONT] = r.guess[REAR] = first;
    r.failure = failure;
    r.effects = effects;
    state s;
    memset(&s, 0, sizeof s);
    if (start > 0.0) {
        quantity load[AXLES];
        wheel_loads(vehicle, &s, 1, 0.0, load);
        s.y[HIL_VEHICLE_OMEGA + FRONT] = s.y[HIL_VEHICLE_OMEGA + REAR] = start;
        s.y[HIL_VEHICLE_SPEED] =
            start * (tyre->radius - (load[FRONT].value + load[REAR].value) / (6.0 * tyre->stiffness));
        s.y[HIL_VEHICLE_TORQUE + FRONT] = torque[0] * load[FRONT].value / load[REAR].value;
        s.y[HIL_VEHICLE_TORQUE + REAR] = torque[0];
    }
    note(&r, &s, 0, record, sensitivity);
    failure->time = 0.0;
    const int limit = swing_limit(&r, &s);
    if (limit != HIL_TYRE_OK) {
        return limit;
    }
    for (int k = 0; k + 1 < samples; k++) {
        const double rise = torque[k + 1] - torque[k];
        for (int i = 0; i < substeps; i++) {
            const double parts = 2.0 * substeps;
            const double t[3] = {torque[k] + rise * (2.0 * i / parts), torque[k] + rise * ((2.0 * i + 1.0) / parts),
                                 torque[k] + rise * ((2.0 * i + 2.0) / parts)};
            failure->time = k * period + i * r.step;
            r.sample = k;
            r.begin = (double)i / substeps;
            r.share = (double)(i + 1) / substeps; /* of the step's end, until the step begins */
            const int status = step(&r, t, &s);
            if (status != HIL_TYRE_OK) {
                return status;
            }
        }
        note(&r, &s, k + 1, record, sensitivity);
    }
    return HIL_TYRE_OK;
}

/* A run and its neighbours, of which each has a row of values. */
typedef struct {
    run run;
    const double *torque;
    int columns;
    int status; /* of the first contact that failed */
    solved known[AXLES];
    hil_vehicle_effects effects;
    hil_moves *moves;
} neighbourhood;

/* State of a flow: that of the run, then the wheels' angles. */
enum { ANGLE = STATE, FLOW = STATE + AXLES };

static const double RELATIVE = 1e-7; /* tolerance of a step: contacts are solved to 1e-9 */
static const double BOUND = 1e9;
static const double SIZE[FLOW] = {1.0, 3.0, 3.0, 1e3, 1e3, 300.0, 300.0, 1.0, 1.0};

static double torque_at(const neighbourhood *n, int sample, double share) {
    return n->torque[sample] + (share > 0.0 ? share * (n->torque[sample + 1] - n->torque[sample]) : 0.0);
}

/* Points the run at a table of values. */
static void take(run *r, const double *values) {
    r->vehicle = (const hil_vehicle *)&values[HIL_VEHICLE_CAR];
    r->tyre = (const hil_tyre *)&values[HIL_VEHICLE_TYRE];
    r->soil = (const hil_tyre_soil *)&values[HIL_VEHICLE_GROUND];
}

static void flow_rates(void *law, int sample, double share, const double *at, double *found) {
    neighbourhood *n = law;
    run *r = &n->run;
    state s, rate;
    memset(&rate, 0, sizeof rate);
    memcpy(s.y, at, sizeof s.y);
    r->sample = sample;
    r->share = share;
    for (int axle = 0; axle < AXLES; axle++) {
        r->angle[axle] = at[ANGLE + axle];
        found[ANGLE + axle] = s.y[HIL_VEHICLE_OMEGA + axle];
    }
    const int status = rates(r, &s, torque_at(n, sample, share), &rate);
    memcpy(found, rate.y, sizeof rate.y);
    for (int i = HIL_VEHICLE_SPEED; i < HIL_VEHICLE_FORCE; i++) { /* the car does not roll back */
        found[i] = at[i] <= 0.0 ? fmax(found[i], 0.0) : found[i];
    }
    if (status != HIL_TYRE_OK) { /* no number: the step is too long, or no soil carries the load */
        n->status = status;
        found[0] = NAN;
    }
}

/* The rates of a neighbour, by its values and its state, next to a point that was just evaluated. */
static void beside(const neighbourhood *n, const double *values, int sample, double share, const double *at,
                   double *found) {
    neighbourhood other = *n;
    other.run.effects = &other.effects;
    other.run.known = other.known;
    other.effects.values = values;
    take(&other.run, values);
    flow_rates(&other, sample, share, at, found);
}

static void flow_derive(void *law, int sample, double share, const double *at, hil_around *found) {
    neighbourhood copy = *(const neighbourhood *)law; /* the run itself goes the same way, followed or not */
    neighbourhood *n = &copy;
    double here[FLOW], there[FLOW], by[STATE][HIL_MOVES_WIDTH];
    unsigned char apart[HIL_ODE_COLUMNS];
    n->run.known = n->known;
    n->run.effects = &n->effects;
    flow_rates(n, sample, share, at, here);
    const double sinkage[AXLES] = {n->known[FRONT].sinkage, n->known[REAR].sinkage};
    const hil_vehicle_point point = {&n->effects, sample, share, torque_at(n, sample, share), at, &at[ANGLE], sinkage};
    hil_vehicle_derive(&point, n->moves, by, apart);
    for (int s = 0; s < STATE; s++) {
        const int held = s >= HIL_VEHICLE_SPEED && s < HIL_VEHICLE_FORCE && at[s] <= 0.0 && here[s] <= 0.0;
        for (int i = 0; i < FLOW; i++) {
            found->a[s][i] = held ? 0.0 : by[s][i];
        }
        for (int c = 0; c < n->columns; c++) {
            found->b[s][c] = held ? 0.0 : by[s][FLOW + c];
        }
    }
    for (int axle = 0; axle < AXLES; axle++) {
        for (int i = 0; i < FLOW; i++) {
            found->a[ANGLE + axle][i] = i == HIL_VEHICLE_OMEGA + axle ? 1.0 : 0.0;
        }
        memset(found->b[ANGLE + axle], 0, sizeof(double) * (size_t)n->columns);
    }
    for (int c = 0; c < n->columns; c++) {
        if (apart[c]) {
            beside(n, n->effects.values + (ptrdiff_t)(c + 1) * n->effects.count, sample, share, at, there);
            for (int s = 0; s < FLOW; s++) {
                found->b[s][c] = there[s] - here[s];
            }
        }
    }
}

/* What a step has rolled back. */
static int flow_settle(void *law, double *at, double by[HIL_FLOW_STATES][HIL_ODE_COLUMNS]) {
    int moved = 0;
    (void)law;
    for (int i = HIL_VEHICLE_SPEED; i < HIL_VEHICLE_FORCE; i++) {
        if (at[i] < 0.0) {
            at[i] = 0.0;
            memset(by[i], 0, sizeof by[i]);
            moved = 1;
        }
    }
    return moved;
}

static void begin_rolling(const run *r, double torque, double start, double *at) {
    state s;
    memset(&s, 0, sizeof s);
    if (start > 0.0) {
        quantity load[AXLES];
        wheel_loads(r->vehicle, &s, 1, 0.0, load);
        s.y[HIL_VEHICLE_OMEGA + FRONT] = s.y[HIL_VEHICLE_OMEGA + REAR] = start;
        s.y[HIL_VEHICLE_SPEED] =
            start * (r->tyre->radius - (load[FRONT].value + load[REAR].value) / (6.0 * r->tyre->stiffness));
        s.y[HIL_VEHICLE_TORQUE + FRONT] = torque * load[FRONT].value / load[REAR].value;
        s.y[HIL_VEHICLE_TORQUE + REAR] = torque;
    }
    memset(at, 0, sizeof(double) * FLOW);
    memcpy(at, s.y, sizeof s.y);
}

static void note_flow(const neighbourhood *n, int columns, int sample, int samples, const hil_way *way, double *record,
                      double *change) {
    double *row = &record[(ptrdiff_t)sample * HIL_VEHICLE_RECORD];
    memcpy(row, way->state, sizeof(double) * STATE);
    for (int axle = 0; axle < AXLES; axle++) {
        row[HIL_VEHICLE_SINKAGE + axle] = n->run.guess[axle].sinkage;
    }
    for (int c = 0; c < columns; c++) {
        double *more = &change[((ptrdiff_t)c * samples + sample) * HIL_VEHICLE_RECORD];
        memset(more, 0, sizeof(double) * HIL_VEHICLE_RECORD);
        for (int s = 0; s < STATE; s++) {
            more[s] = way->by[s][c];
        }
    }
}

int hil_vehicle_follow(const hil_vehicle_effects *effects, int samples, const double *time, const double *torque,
                       double start, int columns, const double *shape, double *record, double *change) {
    assert(effects->count <= HIL_VEHICLE_VALUES && columns <= HIL_ODE_COLUMNS);
    const guess first = {0.05, 0.0, 0.0, 0.0, 0.0};
    hil_vehicle_failure failure;
    neighbourhood n;
    memset(&n, 0, sizeof n);
    n.torque = torque;
    n.columns = shape != NULL ? 1 : columns;
    n.effects = *effects;
    n.run.columns = n.run.contact_columns = 1;
    n.run.guess[FRONT] = n.run.guess[REAR] = first;
    n.run.known = n.known;
    n.run.failure = &failure;
    n.run.effects = &n.effects;
    take(&n.run, effects->values);
    hil_moves moves;
    hil_moves_begin(&moves, FLOW, n.columns, effects->count, effects->values);
    hil_moves_hold(&moves, HIL_ROLE_TIME);
    for (int i = 0; i < effects->inputs; i++) {
        hil_moves_hold(&moves, effects->slot[i]);
    }
    n.moves = &moves;
    double absolute[FLOW], at[FLOW], other[FLOW];
    for (int s = 0; s < FLOW; s++) {
        absolute[s] = 1e-2 * RELATIVE * SIZE[s];
    }
    const hil_flow flow = {FLOW, columns,    time,        RELATIVE,    absolute, BOUND, 0,
                           &n,   flow_rates, flow_derive, flow_settle, SIZE,     shape};
    hil_way way;
    begin_rolling(&n.run, torque[0], start, at);
    hil_flow_begin(&flow, at, &way);
    for (int c = 0; c < columns; c++) {
        run r = n.run;
        take(&r, &effects->values[(ptrdiff_t)(shape != NULL ? 1 : c + 1) * effects->count]);
        begin_rolling(&r, torque[0], start, other);
        for (int s = 0; s < FLOW; s++) {
            way.by[s][c] = (other[s] - at[s]) * (shape != NULL ? shape[c] : 1.0);
        }
    }
    way.step = samples > 1 ? 0.1 * (time[1] - time[0]) : 0.0;
    way.left = HIL_ODE_MEAN_STEPS * samples;
    note_flow(&n, columns, 0, samples, &way, record, change);
    for (int k = 0; k + 1 < samples; k++) {
        if (hil_flow_interval(&flow, k, &way).kind != HIL_ODE_DONE) {
            return n.status != HIL_TYRE_OK ? n.status : HIL_TYRE_NOT_CONVERGED;
        }
        note_flow(&n, columns, k + 1, samples, &way, record, change);
    }
    return HIL_TYRE_OK;
}
