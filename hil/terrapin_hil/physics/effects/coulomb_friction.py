"""More (or less) dry friction inside than the calibration found."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="coulomb_friction",
    title="Change of dry friction",
    equation=r"\Delta C = \Delta A\,\mathrm{sgn}\,\omega",
    source="Reina et al. 2006, Eq. (4), first term",
    bases=("rolling_steady", "cmr", "pendulum_sphere", "vehicle"),
    parameters=(Parameter("da", "N m", 0.0, meaning="change of the dry friction torque"),),
    needs=(("omega",),),
    expression="da * sign(omega)",
    usual="0.1 * load * radius",
    passive=True,
    firmware={"comp_coulomb": "da"},
)
