"""The engineer's tools: the `terrapin` command and what stands behind it."""

__version__ = "0.1.0"  # as in pyproject.toml
