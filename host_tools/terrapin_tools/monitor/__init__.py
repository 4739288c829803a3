"""`terrapin monitor`: live telemetry in a terminal."""
