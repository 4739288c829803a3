"""Something that follows the position through a gap."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="backlash",
    title="Backlash",
    equation=r"k\,\mathcal{P}_w(x)",
    source="Play operator (Krasnosel'skii and Pokrovskii 1989); each run starts in the middle of the gap",
    bases=("equation",),
    parameters=(
        Parameter("k", "channel/position", 0.0, meaning="what follows the position, a unit of it"),
        Parameter("w", "position", 0.1, 0.001, 2.0, "width of the gap", grid=(0.02, 0.05, 0.1, 0.2, 0.5)),
    ),
    needs=(("position",),),
    expression="k*played",
    transform="play",
    target="channel",
)
