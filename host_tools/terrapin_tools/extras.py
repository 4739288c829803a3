"""Packages that one kind of work alone needs: not installed with the rest, and named where they are missed."""

from __future__ import annotations

import importlib.util

from terrapin_tools.errors import UserError

__all__ = ["installed", "need"]


def installed(package: str) -> bool:
    """Whether Python finds the package; it is not imported."""
    return importlib.util.find_spec(package) is not None


def need(what: str, package: str, extra: str) -> None:
    """UserError that says which extra of pyproject.toml brings the package that `what` needs, where it is not there."""
    if not installed(package):
        raise UserError(f"{what} needs {package}, which is not installed: pip install 'terrapin-robot[{extra}]'")
