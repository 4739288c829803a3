"""Dry friction that is larger at low speed, where the lubricant film breaks."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="stribeck",
    title="Stribeck friction",
    equation=r"\Delta C = a_s\,e^{-(\omega/\omega_s)^2}\,\mathrm{sgn}\,\omega",
    source="Armstrong-Helouvry et al. 1994, Gaussian form",
    bases=("rolling_steady", "cmr", "pendulum_sphere", "vehicle"),
    parameters=(
        Parameter("a_s", "N m", 0.0, meaning="excess of dry friction at rest"),
        Parameter("omega_s", "rad/s", 2.0, 0.05, 100.0, "speed at which it has fallen to 37 %", grid=(0.5, 1, 2, 4, 8)),
    ),
    needs=(("omega",),),
    expression="a_s * exp(-(omega/omega_s)**2) * sign(omega)",
    usual="0.1 * load * radius",
    passive=True,
    firmware={"comp_stribeck": "a_s", "comp_stribeck_speed": "omega_s"},
)
