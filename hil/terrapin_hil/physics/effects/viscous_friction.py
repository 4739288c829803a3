"""More (or less) viscous friction inside than the calibration found."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="viscous_friction",
    title="Change of viscous friction",
    equation=r"\Delta C = b\,\omega",
    source="Reina et al. 2006, Eq. (4), second term",
    bases=("rolling_steady", "cmr", "pendulum_sphere", "vehicle"),
    parameters=(Parameter("b", "N m s/rad", 0.0, meaning="change of the viscous friction coefficient"),),
    needs=(("omega",),),
    expression="b * omega",
    usual="0.1 * load * radius / omega",
    passive=True,
    firmware={"comp_viscous": "b"},
)
