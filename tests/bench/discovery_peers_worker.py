"""The peers themselves, in an environment of their own: one JSON line in (arrays), one out (what they claim).

PySINDy: sparse regression (STLSQ) of the residual on the library's terms, which come scaled to unit rms, so that the
threshold is a size in noise sd. pyoperon: genetic programming on the columns, standardised, with local fits of the
constants and minimum description length as criterion; its effort is a number of evaluations, not a time, so that other
work on the machine does not weaken it. Both see the training runs only; of PySINDy's thresholds the
largest within one standard error (over held-out runs) of the best is taken, and a claim of either counts only if it
lowers the held-out error by more than one standard error: the usual guard against fitting noise.
"""

from __future__ import annotations

import json
import re
import sys
import time
import warnings

import numpy as np

THRESHOLDS = (0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5)
RIDGE = 0.05
SYMBOLS = "add,sub,mul,div,constant,variable,abs,square,sqrtabs,exp,sin,cos"


def better(before: np.ndarray, after: np.ndarray, run: np.ndarray) -> bool:
    """Is the held-out mean square lower by more than one standard error over runs?"""
    gain = np.array([np.mean(before[run == r] ** 2 - after[run == r] ** 2) for r in np.unique(run)])
    return len(gain) > 1 and gain.mean() > gain.std(ddof=1) / np.sqrt(len(gain))


def sindy(task: dict) -> dict:
    import pysindy

    terms, y = np.array(task["terms"]).T, np.array(task["residual"])
    run, held = np.array(task["run"]), np.array(task["held"], dtype=bool)
    tried = []
    for threshold in THRESHOLDS:
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=RIDGE)
        model = pysindy.SINDy(optimizer=optimizer, feature_library=pysindy.IdentityLibrary())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # says when it has thrown all terms away
            model.fit(terms[~held], t=1.0, x_dot=y[~held, None])
        weight = np.asarray(model.coefficients())[0]
        left = y[held] - terms[held] @ weight
        each = np.array([np.mean(left[run[held] == r] ** 2) for r in np.unique(run[held])])
        tried.append((each.mean(), each.std(ddof=1) / np.sqrt(len(each)) if len(each) > 1 else 0.0, weight, left))
    best = min(tried, key=lambda entry: entry[0])
    error, _, weight, left = next(e for e in reversed(tried) if e[0] <= best[0] + best[1])
    if not np.any(weight) or not better(y[held], left, run[held]):
        weight = np.zeros_like(weight)
    size: dict[str, float] = {}
    for name, value in zip(task["names"], weight, strict=True):
        if value:
            size[name] = max(size.get(name, 0.0), abs(float(value)))
    return {"claim": sorted(size), "first": max(size, key=lambda n: size[n]) if size else "", "mse": float(error)}


def operon(task: dict) -> dict:
    from pyoperon.sklearn import SymbolicRegressor

    columns, y = np.array(task["columns"]).T, np.array(task["residual"])
    run, held = np.array(task["run"]), np.array(task["held"], dtype=bool)
    spread = columns[~held].std(axis=0)
    columns = (columns - columns[~held].mean(axis=0)) / np.where(
        spread > 0, spread, 1.0
    ) + 2.0  # away from 0: div, sqrt
    model = SymbolicRegressor(
        allowed_symbols=SYMBOLS,
        optimizer_iterations=5,
        max_length=15,
        generations=10**6,
        max_evaluations=int(task["evaluations"]),
        n_threads=1,
        random_state=int(task["seed"]),
        uncertainty=[1.0],
    )
    model.fit(columns[~held], y[~held])
    left = y[held] - model.predict(columns[held])
    text = model.get_model_string(model.model_, 4)
    read = sorted({task["column_names"][int(n) - 1] for n in re.findall(r"X(\d+)", text)})
    if not read or not better(y[held], left, run[held]):
        return {"claim": [], "text": text}
    return {"claim": read, "text": text}


def main() -> None:
    for line in sys.stdin:
        task = json.loads(line)
        begin = time.process_time()
        try:
            found = {"pysindy": sindy, "pyoperon": operon}[task["peer"]](task)
        except Exception as error:  # reported as a failure of the peer, never as silence
            found = {"failed": f"{type(error).__name__}: {error}"[:300], "claim": []}
        print(json.dumps({**found, "cpu": time.process_time() - begin}), flush=True)


if __name__ == "__main__":
    main()
