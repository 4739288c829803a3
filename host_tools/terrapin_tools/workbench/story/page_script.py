"""The report's script and the style of its plots: the modules of the workbench's page, in one page without a server."""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

__all__ = ["plots_script", "plots_style"]

# In this order: each imports from those before it only.
MODULES = ("basics", "svg_pen", "painting", "plot", "ladder", "heat", "case_plots", "report")
IMPORT = re.compile(r"^import \{ ([^}]+) \} from '\./(\w+)\.js';\n", re.MULTILINE)
EXPORT = re.compile(r"^export (?=(?:const|function|class) (\w+))", re.MULTILINE)


def _read(name: str) -> str:
    return files("terrapin_tools").joinpath("web/static/plots", name).read_text(encoding="utf-8")


def _module(name: str) -> str:
    """A module as a constant of its name that holds what it exports."""
    text = _read(f"{name}.js")
    exported = ", ".join(EXPORT.findall(text))
    text = EXPORT.sub("", IMPORT.sub(r"const { \1 } = module_\2;\n", text))
    if re.search(r"^(import|export) ", text, re.MULTILINE):
        raise ValueError(f"{name}.js: expected imports `{{ a, b }} from './x.js'` and exported declarations only")
    return f"const module_{name} = (() => {{\n{text}return {{ {exported} }};\n}})();\n"


@cache
def plots_script() -> str:
    """The modules as one script, for a page with the elements that report.js fills."""
    return "'use strict';\n" + "".join(map(_module, MODULES))


@cache
def plots_style() -> str:
    """The style of what the script draws; the page names the colours."""
    return _read("plots.css")
