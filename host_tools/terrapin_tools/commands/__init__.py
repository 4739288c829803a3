"""One module a sub-command; each registers itself with `register(app)`."""
