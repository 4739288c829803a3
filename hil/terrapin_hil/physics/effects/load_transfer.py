"""Wheel loads shift to the rear while a car speeds up."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="load_transfer",
    title="Load moves between the axles",
    equation=r"h \to h + \Delta h,\quad F_z = \frac{m g b}{2 L} \mp \frac{m a_x h}{2 L}",
    source="Vella et al. 2024, Eq. (3), with the 1/2 that its print lacks",
    bases=("vehicle",),
    parameters=(Parameter("rise", "m", 0.0, -2.0, 2.0, "height of the centre of gravity above what the model has"),),
    needs=(),
    target="height",
    additive=True,
    expression="rise",
    where="ground",
    plant=False,  # the plant has one wheel
)
