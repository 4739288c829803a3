"""Friction in proportion to the speed."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="viscous_friction",
    title="Viscous friction",
    equation=r"b\,v",
    source="Newton's law of viscosity",
    bases=("equation",),
    parameters=(Parameter("b", "channel/speed", 0.0, meaning="coefficient of viscous friction"),),
    needs=(("speed",),),
    expression="b*speed",
    target="channel",
)
