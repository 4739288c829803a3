"""A torque sensor whose scale is off."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="torque_gain",
    title="Gain of the torque sensor",
    equation=r"T \to T\,(1 + g)",
    source="Scale error of the torque sensor, after everything else",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(Parameter("g", "1", 0.0, -0.9, 9.0, "relative error of the scale"),),
    needs=(),
    target="torque",
    stage="gain",
    expression="g",
    usual="0.3",
    plant=False,  # a fault of the test rig's sensor
)
