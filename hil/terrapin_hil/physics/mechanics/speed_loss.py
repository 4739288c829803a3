"""Heat in what turns, dry: friction, and the hysteresis of iron."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="speed_loss",
    title="Loss that grows with the speed",
    equation=r"b\,|v|",
    source="Dry friction times speed; hysteresis of iron, Steinmetz 1892",
    bases=("equation",),
    parameters=(Parameter("b", "channel/speed", 0.0, meaning="loss a unit of speed"),),
    needs=(("speed",),),
    expression="b*abs(speed)",
    target="channel",
    channels=("W",),
)
