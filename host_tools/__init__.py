"""The engineer's tools: the `terrapin` command and what stands behind it."""
