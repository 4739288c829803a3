"""A gear or belt behind the drive's friction: it loses a share of what the shell takes, and of no friction."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="gear_behind_friction",
    title="Gear behind the friction loses torque in proportion to the load",
    equation=r"C_m = A\,\mathrm{sgn}\,\omega + B\,\omega + T/\eta,\;\eta \to \eta\,(1 - \lambda)",
    source="Load-dependent loss of teeth and belts (Niemann and Winter, Machine Elements, vol. 2): 1 to 10 % a stage",
    bases=("rolling_sphere",),
    parameters=(Parameter("loss", "1", 0.0, 0.0, 0.6, "share of the torque that is lost on the way"),),
    needs=(),
    target="joint_efficiency",
    expression="-loss",
    usual="0.3",
    plant=False,  # the plant has friction on either side of its gear: motor_coulomb, motor_viscous
)
