#include "vehicle_by.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { FRONT = 0, REAR = 1, AXLES = 2, STATE = HIL_VEHICLE_STATE, WIDTH = HIL_MOVES_WIDTH };

/* Slots of the car's numbers. */
#define CAR(name)  (HIL_VEHICLE_CAR + (int)(offsetof(hil_vehicle, name) / sizeof(double)))
#define TYRE(name) (HIL_VEHICLE_TYRE + (int)(offsetof(hil_tyre, name) / sizeof(double)))

typedef struct {
    double value;
    double by[WIDTH];
} quantity;

static void add(const hil_moves *m, double times, const double *one, double *sum) {
    for (int c = 0; c < m->width; c++) {
        sum[c] += times * one[c];
    }
}

static void begin(const hil_moves *m, double value, quantity *q) {
    q->value = value;
    memset(q->by, 0, sizeof(double) * (size_t)m->width);
}

static void divide(const hil_moves *m, double by, quantity *q) {
    q->value /= by;
    for (int c = 0; c < m->width; c++) {
        q->by[c] /= by;
    }
}

/* Slip of an axle: derivatives by V, by what `rim` moves, and by the floor that holds a slow wheel. */
static void slip_of(const hil_moves *m, double speed, const quantity *rim, double floor, quantity *slip) {
    double by_axle, by_rim;
    begin(m, hil_tyre_slip(speed, rim->value, floor, &by_axle, &by_rim), slip);
    slip->by[HIL_VEHICLE_SPEED] = by_axle;
    add(m, by_rim, rim->by, slip->by);
    if (fmax(speed, rim->value) <= floor) {
        hil_moves_add(m, CAR(speed_floor), by_rim * (speed - rim->value) / floor, slip->by);
    }
}

static void take(hil_moves *m, double *v, int slot, const quantity *q) {
    v[slot] = q->value;
    memcpy(hil_moves_row(m, slot), q->by, sizeof(double) * (size_t)m->width);
}

/* Values and their moves as effects on one axle, or on the car as a whole (axle = AXLES), leave them; torque and
 * inertia that they add. */
static void apply(const hil_vehicle_point *p, hil_moves *m, const double *table, int axle, const quantity *load,
                  const quantity *torque, double *v, quantity *resist, quantity *inertia) {
    const int car = axle == AXLES;
    const int wheel = car ? REAR : axle;
    const double speed = p->state[HIL_VEHICLE_SPEED];
    const double omega = p->state[HIL_VEHICLE_OMEGA + wheel];
    const double floor = table[CAR(speed_floor)];
    quantity role;
    hil_moves_again(m);
    memcpy(v, table, sizeof(double) * (size_t)p->effects->count);
    begin(m, omega, &role);
    role.by[HIL_VEHICLE_OMEGA + wheel] = 1.0;
    take(m, v, HIL_ROLE_OMEGA, &role);
    begin(m, p->angle[wheel], &role);
    role.by[STATE + wheel] = 1.0;
    take(m, v, HIL_ROLE_ANGLE, &role);
    quantity rim;
    begin(m, table[TYRE(radius)] * omega, &rim);
    rim.by[HIL_VEHICLE_OMEGA + wheel] = table[TYRE(radius)];
    hil_moves_add(m, TYRE(radius), omega, rim.by);
    slip_of(m, speed, &rim, floor, &role);
    take(m, v, HIL_ROLE_SLIP, &role);
    begin(m, car ? speed : fmax(fabs(speed), floor), &role);
    if (car || fabs(speed) > floor) {
        role.by[HIL_VEHICLE_SPEED] = car ? 1.0 : copysign(1.0, speed);
    } else {
        hil_moves_add(m, CAR(speed_floor), 1.0, role.by);
    }
    take(m, v, HIL_ROLE_SPEED, &role);
    begin(m, 2.0 * table[HIL_ROLE_PASS] - (wheel == FRONT ? 1.0 : 0.0), &role);
    hil_moves_add(m, HIL_ROLE_PASS, 2.0, role.by);
    take(m, v, HIL_ROLE_PASS, &role);
    take(m, v, HIL_ROLE_LOAD, load);
    take(m, v, HIL_ROLE_DRIVE_TORQUE, torque);
    hil_moves_change(p->effects->additions, 0, v, m);
    hil_moves_change(p->effects->additions, 1, v, m);
    resist->value = hil_moves_torque(p->effects->additions, car, v, m, &inertia->value, resist->by, inertia->by);
}

/* One wheel: the moves of its omega', F_x' and M_y'. */
static void wheel_by(const hil_vehicle_point *p, hil_moves *m, const double *table, int axle, const quantity *load,
                     const quantity *torque, double by[STATE][WIDTH], unsigned char *apart) {
    double v[HIL_VEHICLE_VALUES];
    quantity resist, inertia;
    apply(p, m, table, axle, load, torque, v, &resist, &inertia);
    const double speed = p->state[HIL_VEHICLE_SPEED];
    const int i_omega = HIL_VEHICLE_OMEGA + axle;
    const double omega = p->state[i_omega];
    const double stiffness = v[TYRE(stiffness)];
    const double floor = v[CAR(speed_floor)];

    quantity flat, rim, slip; /* deflection, speed of the rim */
    begin(m, load->value, &flat);
    add(m, 1.0, load->by, flat.by);
    divide(m, stiffness, &flat);
    hil_moves_add(m, TYRE(stiffness), -flat.value / stiffness, flat.by);
    const double radius = v[TYRE(radius)] - flat.value / 3.0; /* R_e */
    begin(m, radius * omega, &rim);
    rim.by[i_omega] = radius;
    hil_moves_add(m, TYRE(radius), omega, rim.by);
    add(m, -omega / 3.0, flat.by, rim.by);
    slip_of(m, speed, &rim, floor, &slip);

    hil_tyre tyre;
    hil_tyre_soil soil;
    hil_tyre_contact contact;
    unsigned wanted = 0U; /* numbers of the soil that something moves */
    for (unsigned q = 0U; q < HIL_VEHICLE_SOIL; q++) {
        wanted |= m->row[HIL_VEHICLE_GROUND + (int)q] >= 0 ? 1U << q : 0U;
    }
    memcpy(&tyre, &v[HIL_VEHICLE_TYRE], sizeof tyre);
    memcpy(&soil, &v[HIL_VEHICLE_GROUND], sizeof soil);
    hil_tyre_evaluate_by(&tyre, &soil, p->sinkage[axle], flat.value, slip.value, HIL_TYRE_COLUMNS, wanted, &contact);
    double steady[3][WIDTH];
    for (int k = 0; k < 3; k++) {
        const double *d = contact.derivative[k];
        memset(steady[k], 0, sizeof(double) * (size_t)m->width);
        add(m, d[HIL_TYRE_BY_DEFLECTION], flat.by, steady[k]);
        add(m, d[HIL_TYRE_BY_SLIP], slip.by, steady[k]);
        for (int q = 0; q < HIL_VEHICLE_SOIL; q++) {
            hil_moves_add(m, HIL_VEHICLE_GROUND + q, d[HIL_TYRE_BY_SOIL + q], steady[k]);
        }
    }
    double deeper[WIDTH]; /* F_z(z, ...) = load */
    const double slope = contact.derivative[HIL_TYRE_LOAD][HIL_TYRE_BY_Z];
    for (int c = 0; c < m->width; c++) {
        deeper[c] = (load->by[c] - steady[HIL_TYRE_LOAD][c]) / slope;
    }

    quantity quickness; /* fastest / lambda */
    begin(m, fmax(fmax(fabs(speed), fabs(rim.value)), floor), &quickness);
    if (quickness.value <= floor) {
        hil_moves_add(m, CAR(speed_floor), 1.0, quickness.by);
    } else if (fabs(rim.value) >= fabs(speed)) {
        add(m, copysign(1.0, rim.value), rim.by, quickness.by);
    } else {
        quickness.by[HIL_VEHICLE_SPEED] = copysign(1.0, speed);
    }
    const double length = v[CAR(relaxation_length)];
    divide(m, length, &quickness);
    hil_moves_add(m, CAR(relaxation_length), -quickness.value / length, quickness.by);

    const int rows[2] = {HIL_VEHICLE_FORCE + axle, HIL_VEHICLE_TORQUE + axle};
    const int of[2] = {HIL_TYRE_FORCE, HIL_TYRE_TORQUE};
    for (int k = 0; k < 2; k++) {
        double *row = by[rows[k]];
        memset(row, 0, sizeof(double) * (size_t)m->width);
        add(m, contact.value[of[k]] - p->state[rows[k]], quickness.by, row);
        add(m, quickness.value, steady[of[k]], row);
        add(m, quickness.value * contact.derivative[of[k]][HIL_TYRE_BY_Z], deeper, row);
        row[rows[k]] -= quickness.value;
    }
    double *row = by[i_omega];
    const double turned = v[CAR(wheel_inertia)] + inertia.value;
    const double rate = (torque->value - p->state[HIL_VEHICLE_TORQUE + axle] - resist.value) / turned;
    memset(row, 0, sizeof(double) * (size_t)m->width);
    add(m, 1.0 / turned, torque->by, row);
    add(m, -1.0 / turned, resist.by, row);
    add(m, -rate / turned, inertia.by, row);
    hil_moves_add(m, CAR(wheel_inertia), -rate / turned, row);
    row[HIL_VEHICLE_TORQUE + axle] -= 1.0 / turned;

    const int others[4] = {TYRE(radius), TYRE(width), TYRE(angle_share), TYRE(angle_slip)};
    for (int k = 0; k < 4; k++) {
        for (int c = m->states; c < m->width && m->row[others[k]] >= 0; c++) {
            apart[c - m->states] |= m->by[m->row[others[k]]][c] != 0.0;
        }
    }
}

void hil_vehicle_derive(const hil_vehicle_point *p, hil_moves *m, double by[STATE][WIDTH], unsigned char *apart) {
    const hil_vehicle_effects *e = p->effects;
    double table[HIL_VEHICLE_VALUES], v[HIL_VEHICLE_VALUES];
    memcpy(table, e->values, sizeof(double) * (size_t)e->count);
    for (int i = 0; i < e->inputs; i++) {
        const double *at = &e->input[(ptrdiff_t)p->sample * e->inputs + i];
        table[e->slot[i]] = at[0] + (p->share > 0.0 ? p->share * (at[e->inputs] - at[0]) : 0.0);
    }
    const double speed = p->state[HIL_VEHICLE_SPEED];
    quantity load[AXLES], torque[AXLES], resist, inertia, net;

    hil_moves_again(m);
    begin(m, table[CAR(mass)] * table[CAR(gravity)], &load[REAR]); /* the whole car's */
    hil_moves_add(m, CAR(mass), table[CAR(gravity)], load[REAR].by);
    hil_moves_add(m, CAR(gravity), table[CAR(mass)], load[REAR].by);
    begin(m, p->torque, &torque[REAR]);
    apply(p, m, table, AXLES, &load[REAR], &torque[REAR], v, &resist, &inertia);
    const double radius = v[TYRE(radius)];
    divide(m, radius, &resist);
    hil_moves_add(m, TYRE(radius), -resist.value / radius, resist.by);
    divide(m, radius * radius, &inertia);
    hil_moves_add(m, TYRE(radius), -2.0 * inertia.value / radius, inertia.by);

    /* what accelerates the car */
    const double drag = v[CAR(drag)];
    begin(m,
          2.0 * (p->state[HIL_VEHICLE_FORCE + FRONT] + p->state[HIL_VEHICLE_FORCE + REAR]) - drag * speed * speed -
              resist.value,
          &net);
    net.by[HIL_VEHICLE_FORCE + FRONT] = net.by[HIL_VEHICLE_FORCE + REAR] = 2.0;
    net.by[HIL_VEHICLE_SPEED] = -2.0 * drag * speed;
    hil_moves_add(m, CAR(drag), -speed * speed, net.by);
    add(m, -1.0, resist.by, net.by);
    const double mass = v[CAR(mass)] + inertia.value;
    memset(by[HIL_VEHICLE_SPEED], 0, sizeof(double) * (size_t)m->width);
    add(m, 1.0 / mass, net.by, by[HIL_VEHICLE_SPEED]);
    add(m, -net.value / (mass * mass), inertia.by, by[HIL_VEHICLE_SPEED]);
    hil_moves_add(m, CAR(mass), -net.value / (mass * mass), by[HIL_VEHICLE_SPEED]);

    const double both = 2.0 * (v[CAR(front_distance)] + v[CAR(rear_distance)]);
    const int arm[AXLES] = {CAR(rear_distance), CAR(front_distance)};
    begin(m, v[HIL_ROLE_DRIVE_TORQUE], &torque[REAR]);
    hil_moves_add(m, HIL_ROLE_DRIVE_TORQUE, 1.0, torque[REAR].by);
    for (int axle = 0; axle < AXLES; axle++) {
        const double shift = (axle == FRONT ? -1.0 : 1.0) * v[CAR(height)] / both;
        const double rests = v[CAR(mass)] * v[CAR(gravity)] * v[arm[axle]] / both;
        begin(m, rests + shift * net.value, &load[axle]);
        if (load[axle].value < v[CAR(load_floor)]) {
            load[axle].value = v[CAR(load_floor)];
            hil_moves_add(m, CAR(load_floor), 1.0, load[axle].by);
            continue;
        }
        double *row = load[axle].by;
        hil_moves_add(m, CAR(mass), rests / v[CAR(mass)], row);
        hil_moves_add(m, CAR(gravity), v[CAR(mass)] * v[arm[axle]] / both, row);
        hil_moves_add(m, arm[axle], v[CAR(mass)] * v[CAR(gravity)] / both, row);
        hil_moves_add(m, CAR(height), (axle == FRONT ? -1.0 : 1.0) * net.value / both, row);
        hil_moves_add(m, CAR(front_distance), -2.0 * load[axle].value / both, row);
        hil_moves_add(m, CAR(rear_distance), -2.0 * load[axle].value / both, row);
        add(m, shift, net.by, row);
    }
    const double ratio = load[FRONT].value / load[REAR].value;
    const double share = torque[REAR].value / load[REAR].value;
    begin(m, torque[REAR].value * ratio, &torque[FRONT]);
    add(m, ratio, torque[REAR].by, torque[FRONT].by);
    add(m, share, load[FRONT].by, torque[FRONT].by);
    add(m, -share * ratio, load[REAR].by, torque[FRONT].by);
    memset(apart, 0, (size_t)(m->width - m->states));
    for (int axle = 0; axle < AXLES; axle++) {
        wheel_by(p, m, table, axle, &load[axle], &torque[axle], by, apart);
    }
}
