"""What a supply, a lead or a winding takes of a voltage."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="resistance",
    title="Resistance",
    equation=r"r\,i",
    source="Ohm's law",
    bases=("equation",),
    parameters=(Parameter("r", "channel/current", 0.0, meaning="resistance"),),
    needs=(("current",),),
    expression="r*current",
    target="channel",
    channels=("V",),
)
