"""A shell whose centre of mass is off its axis."""

from math import pi

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="shell_imbalance",
    title="Imbalance of the shell",
    equation=r"\Delta C = m_e \sin(\alpha + \varphi)",
    source="Moment of the shell's weight about the axle, once a turn",
    bases=("rolling_steady", "cmr", "pendulum_sphere", "vehicle"),
    parameters=(
        Parameter("m_e", "N m", 0.0, 0.0, meaning="weight times eccentricity"),
        Parameter("phase", "rad", 0.0, -2 * pi, 2 * pi, "angle at which it starts", grid=(-pi / 2, 0.0, pi / 2, pi)),
    ),
    needs=(("angle",),),
    expression="m_e * sin(angle + phase)",
    usual="0.3 * load * radius",
    on={"pendulum_sphere": "rolling_resistance"},
    firmware={"comp_imbalance": "m_e", "comp_imbalance_phase": "phase"},
)
