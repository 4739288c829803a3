"""A sensor that reads too much or too little."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="gain",
    title="Gain of the sensor",
    equation=r"y \to y\,(1 + g)",
    source="Gain error of the channel's sensor, or of what drives it",
    bases=("equation",),
    parameters=(Parameter("g", "1", 0.0, -0.8, 4.0, "gain error, a share"),),
    needs=(),
    target="channel",
    stage="gain",
    channels=("", "W"),
    expression="g",
)
