"""Iron that saturates: less torque for more current."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="saturation",
    title="Saturation",
    equation=r"k\,i\,|i|",
    source="First odd-symmetric correction of the straight line between torque and current",
    bases=("equation",),
    parameters=(Parameter("k", "channel/current**2", 0.0, meaning="curvature"),),
    needs=(("current", "torque"),),
    expression="k*current*abs(current)",
    target="channel",
)
