"""Soil that is stiffer when it is loaded faster."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="rate_effect",
    title="Soil stiffens with speed",
    equation=r"k_s \to k_s \left(v / 0.1\,\mathrm{m/s}\right)^m",
    source="Power law of penetration rate, after Grahn 1991",
    bases=("sphere_contact", "wheel_contact", "vehicle"),
    parameters=(Parameter("m", "1", 0.0, -2.0, 2.0, "exponent of the speed"),),
    needs=(("speed",),),
    positive=("speed",),
    target="k_s",
    expression="(speed/0.1)**m - 1",
    plant=False,  # the plant's default ground knows no sinkage
)
