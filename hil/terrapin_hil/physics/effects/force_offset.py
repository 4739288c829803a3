"""A force sensor that does not read zero at zero."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="force_offset",
    title="Offset of the force sensor",
    equation=r"P \to P + f_0",
    source="Zero error of the force sensor",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(Parameter("f_0", "N", 0.0, meaning="reading at zero force"),),
    needs=(),
    target="traction",
    stage="measured",
    expression="f_0",
    usual="0.2 * load",
    plant=False,  # a fault of the test rig's sensor
)
