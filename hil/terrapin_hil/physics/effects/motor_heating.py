"""Magnets that weaken as the winding heats: less torque for the same current."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="motor_heating",
    title="Torque constant falls as the motor heats",
    equation=r"K_t \to K_t\,\left(1 - a_t (\vartheta - 25^\circ\mathrm{C})\right)",
    source="Linear temperature coefficient of the magnets; ferrite -0.2 %/K, NdFeB -0.1 %/K",
    bases=("rolling_steady", "cmr"),
    parameters=(Parameter("a_t", "1/K", 0.0, -0.01, 0.01, "loss of torque constant a kelvin"),),
    needs=(("temperature",),),
    target="torque_constant",
    expression="-a_t * (temperature - 25)",
    usual="0.004",
    firmware={"comp_heating": "a_t"},
)
