"""A parameter that changes with temperature."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="heating",
    title="A parameter changes with temperature",
    equation=r"p \to p\,\left(1 + a (T - 25^\circ\mathrm{C})\right)",
    source="First order in the temperature; copper +0.39 %/K, magnets -0.1 to -0.2 %/K",
    bases=("equation",),
    parameters=(Parameter("a", "1/K", 0.0, -0.05, 0.05, "change of the parameter a kelvin, a share"),),
    needs=(("temperature",),),
    expression="a*(temperature - 25)",
    target="parameter",
)
