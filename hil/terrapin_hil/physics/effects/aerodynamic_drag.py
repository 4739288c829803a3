"""Drag of the air on the shell; it acts at the axle, so the contact must balance it."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="aerodynamic_drag",
    title="Drag of the air",
    equation=r"\Delta C = \tfrac12\,\rho_\mathrm{air}\,c_d A\,v\,|v|\,R",
    source="Quadratic drag law; density of air 1.225 kg/m^3 (ISO 2533, sea level, 15 degC)",
    bases=("rolling_steady", "cmr", "pendulum_sphere", "vehicle"),
    parameters=(Parameter("cda", "m^2", 0.0, 0.0, meaning="drag coefficient times frontal area"),),
    needs=(("speed", "omega"),),  # speed where it is mapped, else R omega
    expression="0.5 * 1.225 * cda * speed * abs(speed) * radius",
    usual="1.2 * 3.141592653589793 * radius**2",
    where="ground",
    passive=True,
)  # no compensation: what the contact balances is part of C_t
