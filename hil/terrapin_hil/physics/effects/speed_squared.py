"""Rolling resistance that grows with the square of the speed."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="speed_squared",
    title="Rolling resistance grows with speed squared",
    equation=r"\Delta C = f_s\,\omega^2 R W\,\mathrm{sgn}\,\omega",
    source="Reina et al. 2006, Eq. (2)",
    bases=("rolling_steady", "cmr", "pendulum_sphere"),
    parameters=(Parameter("f_s", "s^2/rad^2", 0.0, meaning="speed coefficient of the ground's resistance"),),
    needs=(("omega",),),
    expression="f_s * omega**2 * radius * load * sign(omega)",
    usual="0.1 / omega**2",
    where="ground",
    passive=True,
)
