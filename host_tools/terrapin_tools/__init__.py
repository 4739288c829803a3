"""Terrapin for programs: cases of measurements, simulated and real robots, their logs.

    import terrapin_tools as terrapin

    case = terrapin.Case.from_table(table, run="run", units=..., equation=..., fit=...)
    better = case.add(case.discover().missing)

docs/python.md has the reference. What is not in `__all__` may change. Nothing is imported before it is used.
"""

import importlib

__version__ = "0.1.0"  # as in pyproject.toml
_HOMES = {name: f"terrapin_tools.door.{name.lower()}" for name in
          ("Answer", "Case", "Effect", "Link", "Log", "Robot", "Session")}  # fmt: skip
__all__ = ["Answer", "Case", "Effect", "Link", "Log", "Robot", "Session", "errors"]


def __getattr__(name: str) -> object:
    """A public name, imported when it is first used (PEP 562)."""
    if name == "errors":
        return importlib.import_module("terrapin_tools.errors")
    if name not in _HOMES:
        raise AttributeError(f"module 'terrapin_tools' has no attribute {name!r}")
    found = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
