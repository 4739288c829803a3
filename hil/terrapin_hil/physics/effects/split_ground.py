"""Left and right wheels of a car on unlike ground: one side slips more than the model says, the other less.

A first look, not four wheels. Of how a car with four of them parts, whose left soil is 10 to 20 % softer and whose
right one as much firmer (tests/campaigns/own_bodies.py), 4 % of the mean square are left over 5 s, 29 % over the first
2.5 s, where the wheels swing in.
"""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="split_ground",
    title="Left and right wheels on unlike ground",
    equation=r"i \to i \pm \delta\,i\,(1 - i)^2\;\text{(left, right)},\; \Delta\omega = \pm\delta\,\omega\,i\,(1 - i)",
    source="Vella et al. 2024, Eqs. (1) and (2), for a small difference of the two soils [our assumption]",
    bases=("vehicle",),
    parameters=(Parameter("split", "1", 0.0, -2.0, 2.0, "share by which the left wheels slip more, at little slip"),),
    needs=(),
    target="encoder",
    expression="split * side * omega * max(slip, 0) * (1 - min(slip, 1))",  # side: 1 left, -1 right
    plant=False,  # the plant has one wheel
)
