"""Signed images, and the ways to put them on a controller: one module a programmer."""
