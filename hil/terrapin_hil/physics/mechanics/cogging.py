"""A ripple with the position: magnets, teeth, balls. Once a turn is no cogging but an imbalance.py."""

from math import pi

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="cogging",
    title="Cogging",
    equation=r"k \sin(n\,x + \varphi)",
    source="First harmonic of a periodic detent force; n whole, 2 to 64, if x is an angle",
    bases=("equation",),
    parameters=(
        Parameter("k", "channel", 0.0, 0.0, meaning="amplitude of the ripple"),
        Parameter("n", "rad/position", 1.0, 1.0, 64.0, "waves", whole=True, grid=tuple(map(float, range(1, 65)))),
        Parameter("phase", "rad", 0.0, -2 * pi, 2 * pi, "angle at which it starts", grid=(-pi / 2, 0.0, pi / 2, pi)),
    ),
    needs=(("position",),),
    expression="k*sin(n*position + phase)",
    target="channel",
)
