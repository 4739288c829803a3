"""What drives the equations acts later than it is recorded, or was recorded late."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="input_delay",
    title="Delay of the inputs",
    equation=r"u(t) \to u(t - \tau)",
    source="Dead time of an actuator or a bus; below 0, an input that was recorded late, or by another clock",
    bases=("ode",),
    parameters=(Parameter("delay", "s", 0.0, meaning="time after which an input acts"),),
    needs=(),
    target="inputs",
    transform="inputs",
    expression="delay",
    plant=False,
)
