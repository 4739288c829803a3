"""A spring behind a gap: an end stop, a loose coupling that springs back."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="dead_zone",
    title="A spring behind a gap",
    equation=r"k\,\mathrm{sgn}\,x\,\max(|x| - w, 0)",
    source="Hooke's law beyond a gap; what is held in the gap by friction is backlash",
    bases=("equation",),
    parameters=(
        Parameter("k", "channel/position", 0.0, meaning="stiffness of the spring"),
        Parameter("w", "position", 0.2, 0.01, 0.9, "half of the gap", grid=(0.05, 0.1, 0.2, 0.4, 0.6)),
    ),
    needs=(("position",),),
    expression="k*sign(position)*max(abs(position) - w, 0)",
    target="channel",
    reverses=("position",),
)
