#include "robot.h"

hil_robot_derived hil_robot_derive(const hil_robot *robot) {
    const double offset = robot->radius - robot->drive_radius;
    hil_robot_derived d;
    d.mass = robot->shell_mass + robot->body_mass + robot->drive_mass;
    d.weight = d.mass * robot->gravity;
    d.imbalance = offset * robot->drive_mass + robot->arm * robot->body_mass;
    d.swing_inertia =
        robot->body_inertia + robot->body_mass * robot->arm * robot->arm + robot->drive_mass * offset * offset;
    d.gear = robot->radius / robot->drive_radius;
    d.roll = offset / robot->drive_radius;
    return d;
}

double hil_motor_current(const hil_drive *drive, double gear, double alpha_rate) {
    if (!drive->enabled) {
        return 0.0;
    }
    const double emf = drive->torque_constant * gear * alpha_rate;
    const double resistance = drive->armature_resistance + drive->supply_resistance * drive->duty * drive->duty;
    return (drive->duty * drive->supply - emf) / resistance;
}

hil_geared hil_gear_passes(const hil_robot *robot, double torque, double alpha_rate) {
    const double smooth = torque - robot->motor_viscous * alpha_rate;
    const double ahead = smooth - robot->motor_coulomb;
    const double astern = smooth + robot->motor_coulomb;
    const double driving = robot->gear_efficiency;
    const double driven = driving * robot->driven_ratio;
    const double low = ahead > 0.0 ? driving * ahead : ahead / driven;
    const double high = astern < 0.0 ? driving * astern : astern / driven;
    const hil_geared passed = {0.5 * (low + high), 0.5 * (high - low)};
    return passed;
}
