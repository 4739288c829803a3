"""Copper that resists more as it heats: less current at the same voltage."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="winding_temperature",
    title="Winding resistance rises with its temperature",
    equation=r"R_a \to R_a\,\left(1 + a_r (\vartheta - 25^\circ\mathrm{C})\right)",
    source="Temperature coefficient of copper, 0.39 %/K (IEC 60028)",
    bases=("cmr",),
    parameters=(Parameter("a_r", "1/K", 0.0, 0.0, 0.02, "rise of the resistance a kelvin"),),
    needs=(("temperature",),),
    target="armature_resistance",
    expression="a_r * (temperature - 25)",
)
