"""Drag of a fluid."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="speed_squared",
    title="Drag grows with speed squared",
    equation=r"k\,v\,|v|",
    source="Quadratic drag law: rho c_d A / 2 of a body in a fluid",
    bases=("equation",),
    parameters=(Parameter("k", "channel/speed**2", 0.0, meaning="coefficient of the drag"),),
    needs=(("speed",),),
    expression="k*speed*abs(speed)",
    target="channel",
)
