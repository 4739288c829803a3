"""Heat in a winding."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="copper_loss",
    title="Copper loss",
    equation=r"r\,i^2",
    source="Joule's law; a torque stands for the current that makes it",
    bases=("equation",),
    parameters=(Parameter("r", "channel/current**2", 0.0, meaning="resistance"),),
    needs=(("current", "torque"),),
    expression="r*current**2",
    target="channel",
    channels=("W",),
)
