"""A rut that springs back behind the shell and pushes it on."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="rut_recovery",
    title="The rut springs back",
    equation=r"\theta_{x2} = -\lambda\,\theta_{x1}",
    source="Exit angle after Ishigami et al. 2007; front stress mapped linearly on to the rear",
    bases=("sphere_contact", "wheel_contact"),
    parameters=(Parameter("lam", "1", 0.0, 0.0, 0.9, "exit angle over entry angle", grid=(0.2, 0.5)),),
    needs=(),
    target="recovery",
    additive=True,
    expression="lam",
    plant=False,  # the plant's default ground knows no sinkage
)
