"""The answer of `terrapin soil plates`: for programs, in words, and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from terrapin_tools.figure_style import PANELS, picture
from terrapin_tools.soil.plates import LawFit, Plates, analyse, fit, replicate_sd

__all__ = ["answer", "describe", "plot"]


def answer(title: str, plates: Plates) -> tuple[dict[str, Any], list[LawFit]]:
    """Every law with its errors, the best by the size left out, and the scatter of repeats."""
    fits = analyse(plates)
    best = min(fits, key=lambda f: f.left_out)
    result = {
        "schema": "terrapin.soil_plates/1",
        "file": title,
        "rows": int(plates.size.size),
        "tests": len(plates.test_names),
        "sizes": plates.sizes.tolist(),
        "reference_size": plates.reference,
        "replicate_sd": replicate_sd(plates),
        "unit": "Pa",
        "best": best.law.name,
        "laws": [_law(f, plates) for f in fits],
    }
    return result, fits


def _law(f: LawFit, plates: Plates) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "law": f.law.name,
        "formula": f.law.formula,
        "parameters": {
            name: {"value": float(value), "sd": float(sd), "unit": unit}
            for name, value, sd, unit in zip(f.law.parameters, f.q, f.sd, f.law.units(f.q), strict=True)
        },
        "error": f.error,
        "left_out_error": f.left_out,
        "left_out_by_size": [{"size": size, "error": error} for size, error in f.by_size.items()],
    }
    if f.law.name.startswith("exponent"):
        step = plates.sizes / plates.reference
        shift = step - 1.0 if f.law.name == "exponent_linear" else np.log(step)
        entry["exponent_by_size"] = [
            {"size": float(s), "n": float(n), "k": float(f.q[0]), "unit": f"Pa/m^{n:.6g}"}
            for s, n in zip(plates.sizes, f.q[1] + f.q[2] * shift, strict=True)
        ]
    return entry


def describe(result: dict[str, Any]) -> str:
    """The answer in words, pressures in kPa."""
    sizes = ", ".join(f"{1e3 * size:g}" for size in result["sizes"])
    lines = [f"{result['file']}: {result['rows']} rows, {result['tests']} tests, plates of {sizes} mm"]
    if result["replicate_sd"] is not None:
        lines.append(
            f"  tests of one size differ by {1e-3 * result['replicate_sd']:.2f} kPa (sd): no law can be better"
        )
    lines.append("  law               error kPa   a size left out kPa (each size)")
    for law in result["laws"]:
        each = ", ".join(f"{1e-3 * entry['error']:.2f}" for entry in law["left_out_by_size"])
        mark = "  <- best" if law["law"] == result["best"] else ""
        lines.append(
            f"  {law['law']:<16}{1e-3 * law['error']:9.2f} {1e-3 * law['left_out_error']:14.2f}   ({each}){mark}"
        )
    for law in result["laws"]:
        lines.append(f"  {law['law']}: {law['formula']}")
        for name, entry in law["parameters"].items():
            scaled = entry["unit"].startswith("Pa")
            factor, unit = (1e-3, f"k{entry['unit']}") if scaled else (1.0, entry["unit"].replace("1", ""))
            lines.append(f"    {name:<6}{factor * entry['value']:12.5g} +- {factor * entry['sd']:.2g} {unit}".rstrip())
        if "exponent_by_size" in law:
            each = ", ".join(f"{entry['n']:.4f} at {1e3 * entry['size']:g} mm" for entry in law["exponent_by_size"])
            lines.append(f"    n = {each}; b_r = {1e3 * result['reference_size']:.4g} mm")
    lines.append(
        "  the best is the least of five errors with a size left out; with few sizes that choice itself is uncertain"
    )
    return "\n".join(lines)


def plot(result: dict[str, Any], fits: list[LawFit], plates: Plates, file: Path) -> None:
    """Pressure against depth with the best law and Bekker's, each size predicted by the others; errors as bars."""
    from matplotlib import colormaps

    best = next(f for f in fits if f.law.name == result["best"])
    bekker = next(f for f in fits if f.law.name == "bekker")
    with picture(file, (11.0, 4.6), PANELS) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(2, 1))
        for size, color in zip(
            plates.sizes, colormaps["viridis"](np.linspace(0.05, 0.8, len(plates.sizes))), strict=True
        ):
            rows = plates.size == size
            left.plot(1e3 * plates.depth[rows], 1e-3 * plates.pressure[rows], ".", color=color, ms=4)
            z = np.linspace(1e-4, float(plates.depth[rows].max()), 80)
            b = np.full(z.size, size)
            for f, style in ((best, "-"), (bekker, "--")):
                q = fit(f.law, plates, ~rows)
                label = f"{1e3 * size:g} mm, {f.law.name}"
                left.plot(1e3 * z, 1e-3 * f.law.pressure(q, b, z, plates.reference), style, color=color, label=label)
        left.set(xlabel="sinkage, mm", ylabel="pressure, kPa")
        left.set_title("each size as the other sizes predict it", fontsize=10)
        left.legend()
        names = [f.law.name for f in fits]
        right.barh(names[::-1], [1e-3 * f.left_out for f in fits][::-1], color="#2f6fdb")
        right.set_xlabel("error with a size left out, kPa")
        if result["replicate_sd"] is not None:
            right.axvline(1e-3 * result["replicate_sd"], color="#158a74", lw=1, ls="--", label="sd between repeats")
            right.legend()
