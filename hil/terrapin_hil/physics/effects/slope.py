"""A slope that the model takes for level ground."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="slope",
    title="Slope of the ground",
    equation=r"\Delta C = g_\gamma\,W \sin\gamma\,R",
    source="Weight's component along the slope; gain 1 if the inclinometer is right",
    bases=("rolling_steady", "cmr", "pendulum_sphere", "vehicle"),
    parameters=(Parameter("gain", "1", 0.0, meaning="share of the measured slope that acts", grid=(1.0,)),),
    needs=(("slope",),),
    expression="gain * load * sin(slope) * radius",
    usual="1.0",
    where="ground",
    plant=False,  # the plant's ground has its own slope: a scenario sets that
    firmware={"comp_slope": "gain"},
)
