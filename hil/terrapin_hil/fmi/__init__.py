"""FMI 3.0: the robot and its controller as FMUs for other simulators, and FMUs of others in the place of the plant."""
