"""Torque ripple of the motor or of the gear's teeth: a whole number of waves a turn."""

from math import pi

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="cogging",
    title="Cogging",
    equation=r"\Delta C = m_c \sin(k\,\alpha + \varphi)",
    source="First harmonic of a periodic detent torque; k whole, 2 to 64",
    bases=("rolling_steady", "cmr"),
    parameters=(
        Parameter("m_c", "N m", 0.0, 0.0, meaning="amplitude of the ripple"),
        Parameter("k", "1", 2.0, 2.0, 64.0, "waves a turn", whole=True, grid=tuple(map(float, range(2, 65)))),
        Parameter("phase", "rad", 0.0, -2 * pi, 2 * pi, "angle at which it starts", grid=(-pi / 2, 0.0, pi / 2, pi)),
    ),
    needs=(("angle",),),
    expression="m_c * sin(k*angle + phase)",
    usual="0.2 * load * radius",
)
