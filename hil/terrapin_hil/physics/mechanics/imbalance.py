"""A mass off the axis: its weight, once a turn."""

from math import pi

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="imbalance",
    title="Imbalance",
    equation=r"k \sin(x + \varphi)",
    source="Moment of the weight of a mass off the axis, once a turn; x an angle",
    bases=("equation",),
    parameters=(
        Parameter("k", "channel", 0.0, 0.0, meaning="weight times eccentricity, as the channel has it"),
        Parameter("phase", "rad", 0.0, -2 * pi, 2 * pi, "angle at which it starts", grid=(-pi / 2, 0.0, pi / 2, pi)),
    ),
    needs=(("angle",),),
    expression="k*sin(angle + phase)",
    target="channel",
)
