"""What an amplifier's low-pass makes of a signal."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="sensor_lag",
    title="Lag of the sensor",
    equation=r"\tau\,\dot y + y = \hat y",
    source="Low-pass of first order, of a sensor or its amplifier; each run starts settled",
    bases=("equation",),
    parameters=(Parameter("tau", "time", 0.0, 0.0, 0.05, "time constant"),),
    needs=(("time",),),
    expression="tau",
    target="channel",
    channels=("", "W"),
    stage="lag",
    transform="lag",
)
