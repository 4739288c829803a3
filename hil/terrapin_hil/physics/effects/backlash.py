"""Play between the shaft and its encoder: after a reversal the count stands still until the gap is crossed."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="backlash",
    title="Backlash at the encoder",
    equation=r"\alpha \to \mathcal{P}_g(\alpha)",
    source="Play operator (Krasnosel'skii and Pokrovskii 1989) of width g",
    bases=("cmr", "pendulum_sphere"),
    parameters=(Parameter("gap", "rad", 0.0, 0.0, 1.0, "width, at the shell", grid=(0.02, 0.1, 0.3)),),
    needs=(("angle",),),
    target="encoder",
    transform="play",
    expression="gap",
    sensor={"motor.play": "gap"},
)
