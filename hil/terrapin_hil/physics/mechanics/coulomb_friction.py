"""Dry friction: as large at every speed, against the motion."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="coulomb_friction",
    title="Dry friction",
    equation=r"k\,\mathrm{sgn}\,v",
    source="Coulomb's law of friction",
    bases=("equation",),
    parameters=(Parameter("k", "channel", 0.0, meaning="size of the dry friction"),),
    needs=(("speed", "direction"),),
    expression="k*sign(speed)",
    target="channel",
    laws=("dry friction",),
)
