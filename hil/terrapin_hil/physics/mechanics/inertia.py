"""What the acceleration takes."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="inertia",
    title="Inertia",
    equation=r"j\,\dot v",
    source="Newton's second law",
    bases=("equation",),
    parameters=(Parameter("j", "channel/acceleration", 0.0, meaning="mass or moment of inertia"),),
    needs=(("acceleration",),),
    expression="j*acceleration",
    target="channel",
)
