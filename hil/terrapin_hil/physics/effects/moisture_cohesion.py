"""Water between the grains holds them together."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="moisture_cohesion",
    title="Moisture gives cohesion",
    equation=r"c \to c + c_w\,w",
    source="Capillary cohesion, first order in the water content",
    bases=("sphere_contact", "wheel_contact", "vehicle"),
    parameters=(Parameter("c_w", "Pa", 0.0, meaning="cohesion gained a unit of gravimetric water content"),),
    needs=(("moisture",),),
    target="cohesion",
    additive=True,
    expression="c_w * moisture",
    plant=False,  # the plant's default ground knows no cohesion
)
