"""Physics alone: soil contact, motor, rolling bodies, effects. Knows no file format, no bus and no clock."""
