"""The robot in MuJoCo, under Terrapin's controller: a shell on a plane, an inner body that hangs in it, a drive wheel.

plant = MujocoPlant(scenario.robot, shape="cylinder", slope=0.05)
with terrapin.Session(scenario, plant=plant) as s:
    s.step(20.0)

x points uphill along the ground, z away from it; gravity is tilted. The contact is MuJoCo's own: Coulomb friction, and
rolling friction of `resistance` times the radius. A small `impratio` makes its friction soft: below the cone the
traction then rises with the slip, as soil's does; above 1 it is the hard floor's.
"""

import math

import mujoco
import numpy as np

SUBSTEPS = 4  # of a millisecond

XML = """
<mujoco>
  <option timestep="{step}" integrator="implicitfast" cone="elliptic" impratio="{impratio}"
          gravity="{gx} 0 {gz}"/>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 1" {contact}/>
    <body name="axle" pos="0 0 {R}">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>
      <body name="shell">
        <joint name="beta" type="hinge" axis="0 1 0"/>
        <geom name="shell" type="{shape}" size="{size}" euler="90 0 0" mass="0" {contact}/>
        <inertial pos="0 0 0" mass="{shell_mass}" diaginertia="{I_c} {I_c} {I_c}"/>
        <body name="inner">
          <joint name="alpha" type="hinge" axis="0 -1 0" frictionloss="{coulomb}" damping="{viscous}"
                 solreffriction="0.002 1"/>
          <inertial pos="{hx} 0 {hz}" mass="{body_mass}" diaginertia="{I_a} {I_a} {I_a}"/>
          <body name="wheel" pos="{rx} 0 {rz}">
            <joint name="wheel" type="hinge" axis="0 1 0"/>
            <inertial pos="0 0 0" mass="{drive_mass}" diaginertia="{I_r} {I_r} {I_r}"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="wheel" joint2="alpha" polycoef="0 {gear} 0 0 0" solref="0.002 1"/>
  </equality>
  <actuator>
    <motor name="drive" joint="alpha"/>
    <velocity name="carriage" joint="x" kv="0"/>
  </actuator>
</mujoco>
"""


class MujocoPlant:
    """A plant for a session. `robot` is a scenario's; `carriage(t)` is a speed [m/s] of the axle, or None."""

    def __init__(
        self, robot, shape="cylinder", slope=0.0, *, friction=0.6, resistance=0.05, impratio=20, carriage=None
    ):
        R, r, arm = robot.radius, robot.drive_radius, robot.arm
        self.robot, self.carriage, self.gear = robot, carriage, R / r
        down = (-math.sin(slope), -math.cos(slope))
        self.model = mujoco.MjModel.from_xml_string(
            XML.format(
                step=1e-3 / SUBSTEPS, gx=robot.gravity * down[0], gz=robot.gravity * down[1], R=R, shape=shape,
                impratio=impratio,
                size=R if shape == "sphere" else f"{R} 0.05",
                contact=f'condim="6" friction="{friction} 0 {resistance * R}" solref="0.004 1"',
                shell_mass=robot.shell_mass, body_mass=robot.body_mass, drive_mass=max(robot.drive_mass, 1e-6),
                I_c=robot.shell_inertia, I_a=robot.body_inertia, I_r=max(robot.drive_inertia, 1e-9),
                coulomb=robot.coulomb, viscous=robot.viscous, gear=self.gear,
                hx=arm * down[0], hz=arm * down[1], rx=(R - r) * down[0], rz=(R - r) * down[1],
            )
        )  # fmt: skip
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.shell = self.model.body("shell").id

    def contact_torque(self):
        """That resists the shell at the ground [N m], as MuJoCo has it: forces at their arms, and moments."""
        total, wrench = 0.0, np.zeros(6)
        for i in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, i, wrench)
            contact = self.data.contact[i]
            frame = contact.frame.reshape(3, 3)
            force, moment = frame.T @ wrench[:3], frame.T @ wrench[3:]
            arm = contact.pos - self.data.xpos[self.shell]
            total += (np.cross(arm, force) + moment)[1]  # on geom2, the shell: the ground is geom1
        return -total

    def geared(self, motor, rate):
        """What the gear hands on of the motor's torque, and the dry friction before it, at the joint [N m]."""
        robot = self.robot
        driving = robot.gear_efficiency
        driven = driving * robot.driven_ratio
        smooth = self.gear * motor - robot.motor_viscous * rate
        ahead, astern = smooth - robot.motor_coulomb, smooth + robot.motor_coulomb
        low = ahead * driving if ahead > 0.0 else ahead / driven
        high = astern * driving if astern < 0.0 else astern / driven
        return (low + high) / 2, (high - low) / 2

    def __call__(self, voltage):
        robot, data = self.robot, self.data
        torque = motor = current = 0.0
        if self.carriage is not None:
            speed = self.carriage(data.time)
            gain = 0.0 if speed is None else 1e4
            self.model.actuator_gainprm[1, 0], self.model.actuator_biasprm[1, 2] = gain, -gain
            data.ctrl[1] = speed or 0.0
        for _ in range(SUBSTEPS):
            if voltage is not None:
                current = (voltage - robot.torque_constant * self.gear * data.qvel[3]) / robot.armature_resistance
            motor = robot.torque_constant * current
            data.ctrl[0], lost = self.geared(motor, data.qvel[3])
            self.model.dof_frictionloss[3] = robot.coulomb + lost
            mujoco.mj_step(self.model, data)
            torque += self.contact_torque() / SUBSTEPS
        x, _, beta, alpha = data.qpos[:4]
        v, _, omega, rate = data.qvel[:4]
        return {
            "omega": omega, "speed": v, "current": current, "alpha_rate": rate, "position": x, "beta": beta,
            "alpha": alpha, "contact_torque": torque, "motor_torque": motor,
        }  # fmt: skip
