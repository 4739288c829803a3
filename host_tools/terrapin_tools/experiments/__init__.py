"""Designed experiments: which settings to run, and what the results allow one to conclude."""
