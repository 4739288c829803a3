"""Properties of the ground from what a rig measured: a driven wheel (tactile), plates pressed in (plates)."""
