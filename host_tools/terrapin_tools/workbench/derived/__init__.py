"""Columns that a case derives from those of its files: formulas with units, speeds of counts, means over a window."""
