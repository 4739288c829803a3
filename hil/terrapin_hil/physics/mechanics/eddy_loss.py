"""Heat in what turns, viscous: friction in a fluid, and eddy currents in iron."""

from terrapin_hil.physics.effects import Effect, Parameter

EFFECT = Effect(
    name="eddy_loss",
    title="Loss that grows with speed squared",
    equation=r"k\,v^2",
    source="Viscous friction times speed; eddy currents in iron, Steinmetz 1892",
    bases=("equation",),
    parameters=(Parameter("k", "channel/speed**2", 0.0, meaning="loss a unit of speed squared"),),
    needs=(("speed",),),
    expression="k*speed**2",
    target="channel",
    channels=("W",),
)
