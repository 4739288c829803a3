"""Friction of the drive that grows as the body swings out: its bearings and gear carry the moment that holds it up."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="swing_friction",
    title="Friction grows with the swing",
    equation=r"\Delta C = k\,|\sin\varphi|\,\mathrm{sgn}\,\omega",
    source="Coulomb's law for a bearing that carries the moment of the swinging body, m g l sin(phi) [our assumption]",
    bases=("cmr", "pendulum_sphere"),
    parameters=(Parameter("k", "N m", 0.0, 0.0, meaning="friction at a swing of 90 degrees"),),
    needs=(("swing_angle",),),
    expression="k * abs(sin(swing_angle)) * sign(omega)",
    passive=True,
)
