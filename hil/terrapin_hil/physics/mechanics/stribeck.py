"""The part of dry friction that is there at low speed only."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="stribeck",
    title="Stribeck friction",
    equation=r"k\,e^{-(v/v_s)^2}\,\mathrm{sgn}\,v",
    source="Armstrong-Helouvry et al. 1994, Gaussian form",
    bases=("equation",),
    parameters=(
        Parameter("k", "channel", 0.0, meaning="excess of dry friction at rest"),
        Parameter("v_s", "speed", 0.1, 0.002, 1.0, "speed at which it has fallen to 37 %", grid=(0.03, 0.1, 0.2, 0.4)),
    ),
    needs=(("speed",),),
    expression="k*exp(-(speed/v_s)**2)*sign(speed)",
    target="channel",
    laws=("fall of friction with speed",),
)
