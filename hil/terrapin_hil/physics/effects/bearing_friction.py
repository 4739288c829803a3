"""Friction between torque sensor and shell."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="bearing_friction",
    title="Bearing friction",
    equation=r"T \to T + t_b",
    source="Constant torque of a loaded bearing at constant speed",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(Parameter("t_b", "N m", 0.0, meaning="friction torque of the bearing"),),
    needs=(),
    target="torque",
    expression="t_b",
    usual="0.1 * load * radius",
    plant=False,  # friction of the test rig, not of the robot
)
