"""Torque that the acceleration takes."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="inertia",
    title="Inertia",
    equation=r"\Delta C = J\,\dot\omega",
    source="Reina et al. 2006, impulse identity: J = R^2 sum(m) + I_c + I_r (R/r)^2",
    bases=("rolling_steady", "cmr", "pendulum_sphere"),
    parameters=(Parameter("j", "kg m^2", 0.0, 0.0, meaning="moment of inertia at the shell"),),
    needs=(("acceleration",),),
    expression="j * acceleration",
    usual="load / 9.81 * radius**2",
    plant=False,  # the plant's mass matrix holds it: a scenario sets masses and moments
    firmware={"comp_inertia": "j - load / 9.81 * radius**2"},  # the mass is moved by the contact: that part is C_t
)
