"""Logs of runs: candump text and the run's folder, in and out."""
