"""A rut that was rolled before is firmer; a car's rear wheels always roll in one."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="multipass",
    title="Soil stiffens with every pass",
    equation=r"k_s \to k_s\,N^\kappa",
    source="Power law of the number of passes, after Holm 1969",
    bases=("sphere_contact", "wheel_contact", "vehicle"),
    parameters=(Parameter("kappa", "1", 0.0, -3.0, 3.0, "exponent of the number of the pass"),),
    needs=(("pass",),),
    positive=("pass",),
    target="k_s",
    expression="pass_**kappa - 1",
    plant=False,  # the plant's default ground knows no rut
)
