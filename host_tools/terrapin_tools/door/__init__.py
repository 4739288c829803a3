"""The front door for Python: what `import terrapin_tools` offers. See docs/python.md."""
