"""Viscous friction that differs in the two directions: half the difference of their coefficients."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="viscous_asymmetry",
    title="Viscous friction differs in the two directions",
    equation=r"b\,|v|",
    source="A coefficient for either direction: (b_+ - b_-)/2 beside their mean",
    bases=("equation",),
    parameters=(Parameter("b", "channel/speed", 0.0, meaning="half the difference of the two coefficients"),),
    needs=(("speed",),),
    expression="b*abs(speed)",
    target="channel",
    reverses=("speed",),
)
