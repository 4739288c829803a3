"""Torque that swells with the position of the drive."""

from math import pi

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="torque_ripple",
    title="Torque ripple",
    equation=r"K_t \to K_t\,(1 + a \sin(k \alpha + \varphi))",
    source="Harmonic of the air gap's field, or of a gear's or joint's stiffness",
    bases=("cmr", "pendulum_sphere", "vehicle"),
    parameters=(
        Parameter("a", "1", 0.0, 0.0, 0.5, "share of the torque"),
        Parameter("k", "1", 6.0, 1.0, 64.0, "waves a turn", whole=True, grid=(1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)),
        Parameter("phase", "rad", 0.0, -2 * pi, 2 * pi, "angle at which it starts", grid=(-pi / 2, 0.0, pi / 2, pi)),
    ),
    needs=(("angle",),),
    target="torque_constant",
    on={"pendulum_sphere": "torque", "vehicle": "drive_torque"},
    stage="gain",
    expression="a * sin(k*angle + phase)",
)
