"""z3 comes with `make proof`; where it is not there, nothing of the proofs is looked through for doctests."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("z3") else ["arithmetic.py"]
