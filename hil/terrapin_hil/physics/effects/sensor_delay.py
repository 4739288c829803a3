"""Measurements that arrive late."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="sensor_delay",
    title="Delay of the sensors",
    equation=r"y(t) \to y(t - \tau)",
    source="Transport delay of conversion, filter and bus",
    bases=("cmr", "pendulum_sphere", "vehicle"),
    parameters=(Parameter("delay", "s", 0.0, 0.0, 0.5, "time by which measurements are late"),),
    needs=(),
    target="measured",
    transform="delay",
    expression="delay",
    sensor={"motor.delay": "delay", "current.delay": "delay", "swing_angle.delay": "delay"},
)
