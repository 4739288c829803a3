"""A sensor that does not read zero at zero."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="offset",
    title="Offset",
    equation=r"c",
    source="Zero error of the channel's sensor, or a constant load",
    bases=("equation",),
    parameters=(Parameter("c", "channel", 0.0, meaning="reading at zero"),),
    needs=(),
    target="channel",
    channels=("", "W"),
    stage="measured",
    expression="c",
)
