"""A tyre's forces build up over a rolled distance."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="relaxation_length",
    title="Forces build up over a longer way",
    equation=r"\lambda \to \lambda + \Delta\lambda,\quad \dot F = \frac{\max(|V|, |R_e \omega|)}{\lambda}(F_s - F)",
    source="Vella et al. 2024, section 2: relaxation of F_x and M_y",
    bases=("vehicle",),
    parameters=(Parameter("longer", "m", 0.0, -0.25, 2.0, "relaxation length above what the model has"),),
    needs=(),
    target="relaxation_length",
    additive=True,
    expression="longer",
    where="ground",
    plant=False,  # the plant's shell is rigid
)
