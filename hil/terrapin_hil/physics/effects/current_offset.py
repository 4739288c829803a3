"""A current sensor that does not read zero at zero."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="current_offset",
    title="Offset of the current sensor",
    equation=r"i \to i + i_0",
    source="Zero error of the current sensor",
    bases=("rolling_steady", "cmr"),
    parameters=(Parameter("i_0", "A", 0.0, meaning="reading at zero current"),),
    needs=(),
    target="current",
    stage="measured",
    expression="i_0",
    usual="0.2 * current",
    plant=False,  # a sensor's fault: a scenario sets the current sensor's offset
    firmware={"comp_current_offset": "i_0"},
)
