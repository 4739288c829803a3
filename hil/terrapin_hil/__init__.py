"""Hardware in the loop: the simulated robot, its sensors, the links to the firmware, and the runs."""
