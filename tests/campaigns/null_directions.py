"""Parameters beyond what the data determine, in ways that are known: whether they are named, and whether what is
determined of them lies within its interval."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

__all__ = ["KNOWN", "draw", "truth"]

TRUTH = {"a": 1.7, "b": 0.6, "c": 2.4, "d": 0.35}
# equation, and the groups that it does not tell apart
KNOWN = {
    "a*b*w": ["ab"],
    "a*w/b": ["ab"],
    "(a + b)*w": ["ab"],
    "a*w + b*w + c*t": ["ab"],
    "a*b*w + c*t": ["ab"],
    "a*b**2*w": ["ab"],
    "sqrt(a*b)*w": ["ab"],
    "(a*w + b*t)/c": ["abc"],
    "(a*w + b*sign(w) + c*t)/d": ["abcd"],
    "a*b*w + c*d*t": ["ab", "cd"],
    "(a + b)*w + c*t/d": ["ab", "cd"],
    "a*b*c*w": ["abc"],
    "(a - 2*b)*w + c": ["ab"],
    "a*w + b + c": ["bc"],
    "a*exp(-b)*w": ["ab"],
    "a*(b + c)*w + d": ["abc"],
    "a*b*w + b*c*t": ["abc"],
    "a*w**2/(b*c)": ["abc"],
    "a*tanh(w/3)*b + c*w": ["ab"],
    "(a*w + b*w*t)/(c*d)": ["abcd"],
}


def draw(number: int, seed: int, folder: Path) -> list[str]:
    """A case in `folder`; the groups of its parameters that cannot be told apart."""
    formula, groups = list(KNOWN.items())[number]
    random = np.random.default_rng([seed, number])
    run = np.repeat(np.arange(8), 15)
    w, t = random.uniform(-5.0, 5.0, len(run)), random.uniform(0.0, 4.0, len(run))
    names = sorted({name for name in TRUTH if re.search(rf"\b{name}\b", formula)})
    space = {"sqrt": np.sqrt, "exp": np.exp, "tanh": np.tanh, "sign": np.sign, "w": w, "t": t, **TRUTH}
    y = eval(formula, {"__builtins__": {}}, space) + 0.05 * random.standard_normal(len(run))  # a formula of this file
    folder.mkdir(parents=True)
    rows = "".join(f"r{r},{a:.8g},{b:.8g},{c:.8g}\n" for r, a, b, c in zip(run, w, t, y, strict=True))
    (folder / "runs.csv").write_text("run,w,t,y\n" + rows, encoding="utf-8")
    fit = "".join(f"{n} = {{ value = {1.3 * TRUTH[n]:.3g}, min = 0.01, max = 50 }}\n" for n in names)
    (folder / "case.toml").write_text(
        f"""[model]
base = "equation"
[model.equation]
y = "{formula}"
[fit]
{fit}[data]
files = ["runs.csv"]
run = "run"
[data.columns]
w = {{ column = "w" }}
t = {{ column = "t" }}
y = {{ column = "y", sigma = 0.05 }}
""",
        encoding="utf-8",
    )
    return groups


def truth(formula: str) -> float:
    """The true value of a combination."""
    return float(eval(formula.replace("^", "**"), {"__builtins__": {}}, dict(TRUTH)))
