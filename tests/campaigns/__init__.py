"""Campaigns with known answers: many runs, one figure each."""
