"""Dry friction of what creeps or bends before it slides: it turns round gradually."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="smooth_friction",
    title="Dry friction that turns round gradually",
    equation=r"k\,\tanh(v/v_s)",
    source="Andersson, Soderberg and Bjorklund 2007, Eq. 5: Coulomb's law, smoothed",
    bases=("equation",),
    parameters=(
        Parameter("k", "channel", 0.0, meaning="size of the dry friction"),
        Parameter("v_s", "speed", 0.05, 0.002, 0.3, "speed at which it is at 76 %", grid=(0.01, 0.03, 0.1, 0.2)),
    ),
    needs=(("speed",),),
    expression="k*tanh(speed/v_s)",
    target="channel",
    laws=("dry friction",),
    reverses=("speed",),
)
