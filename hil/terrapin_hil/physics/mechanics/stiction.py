"""Dry friction with a breakaway peak, which cannot be told while nothing moves."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="stiction",
    title="Dry friction that is larger at breakaway",
    equation=r"k\,\mathrm{sgn}\,v\,\left(1 + a\,e^{-(v/v_s)^2}\right),\; |v| > v_0",
    source="Armstrong-Helouvry et al. 1994, Gaussian form; at rest it takes what the load asks for",
    bases=("equation",),
    parameters=(
        Parameter("k", "channel", 0.0, meaning="dry friction at speed"),
        Parameter("a", "1", 1.0, 0.1, 10.0, "rise at breakaway, a share of k", grid=(0.5, 2.0)),
        Parameter("v_s", "speed", 0.1, 0.002, 1.0, "speed at which the rise has fallen to 37 %", grid=(0.03, 0.1, 0.3)),
        Parameter("v_0", "speed", 0.0, 0.0, 0.2, "speed below which there is no force", grid=(0.0, 0.02)),
    ),
    needs=(("speed",),),
    expression="k*sign(speed)*(1 + a*exp(-(speed/v_s)**2))*(abs(speed) > v_0)",
    target="channel",
    laws=("dry friction", "fall of friction with speed"),
)
