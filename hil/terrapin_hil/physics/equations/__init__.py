"""Differential equations that a user writes down."""
