"""A tyre that gives way: a flatter circle on the soil, and a smaller rolling radius."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="tyre_flexibility",
    title="The tyre is softer",
    equation=r"\frac{1}{k_z} \to \frac{1}{k_z} + e",
    source="Substitution circle of Vella et al. 2024, section 2; compliances of springs in series add",
    bases=("vehicle",),
    parameters=(Parameter("e", "m/N", 0.0, 0.0, 2e-5, "compliance above what the model has"),),
    needs=(),
    target="tyre_stiffness",
    expression="1/(1 + e*tyre_stiffness) - 1",
    where="ground",
    plant=False,  # the plant's shell is rigid
)
