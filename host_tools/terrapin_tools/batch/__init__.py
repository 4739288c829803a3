"""Many runs of a scenario: what is varied, the runs on all cores or a cluster, their table, what makes them fail."""
