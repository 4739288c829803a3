"""What goes with the position: a spring, a rope that is paid out."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="stiffness",
    title="Stiffness",
    equation=r"k\,x",
    source="Hooke's law",
    bases=("equation",),
    parameters=(Parameter("k", "channel/position", 0.0, meaning="what goes with the position, a unit of it"),),
    needs=(("position",),),
    expression="k*position",
    target="channel",
)
