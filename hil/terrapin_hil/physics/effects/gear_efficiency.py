"""A gear or belt that loses a share of the torque that it passes on."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="gear_efficiency",
    title="Gear loses torque in proportion to the load",
    equation=r"C_m \to \eta\,C_m,\;\eta \to \eta\,(1 - \lambda);\;\text{driven back } C_m \to C_m/\eta",
    source="Load-dependent loss of teeth and belts (Niemann and Winter, Machine Elements, vol. 2): 1 to 10 % a stage",
    bases=("rolling_steady", "rolling_sphere", "cmr", "vehicle"),
    parameters=(Parameter("loss", "1", 0.0, 0.0, 0.6, "share of the torque that is lost on the way"),),
    needs=(),
    target="gear_efficiency",
    on={"vehicle": "drive_torque"},
    expression="-loss",
    usual="0.3",
    firmware={"gear_efficiency": "gear_efficiency * (1 - loss)"},
)
