"""A disc that sits off its axis: the encoder errs once a turn."""

from math import pi

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="encoder_misalignment",
    title="Misaligned encoder",
    equation=r"\alpha \to \alpha + \frac{m}{g} \sin(g \alpha + \varphi)",
    source="Eccentricity of the disc, first harmonic; g turns of the encoder for one of the shell or wheel",
    bases=("cmr", "pendulum_sphere", "vehicle"),
    parameters=(
        Parameter("misalignment", "rad", 0.0, 0.0, 1.0, "amplitude, at the encoder"),
        Parameter("phase", "rad", 0.0, -2 * pi, 2 * pi, "angle at which it starts", grid=(-pi / 2, 0.0, pi / 2, pi)),
    ),
    needs=(("angle",),),
    target="encoder",
    transform="angle",
    expression="misalignment * sin(gear*angle + phase) / gear",
    sensor={"motor.misalignment": "misalignment", "motor.phase": "phase"},
)
