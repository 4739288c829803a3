"""The pictures of the demonstration (PNG, Matplotlib without a display)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from terrapin_hil.arrays import Array
from terrapin_hil.run.run import Result
from terrapin_tools.figure_style import picture

__all__ = ["contact_errors", "forced_slip", "ground_torque", "heated", "slip_limiter", "slope"]

BLUE, RED, GREY, GREEN = "#2f6fdb", "#d0405a", "#68717d", "#158a74"


@contextmanager
def _panels(file: Path, height: float, rows: int, columns: int = 1) -> Iterator[Sequence[Any]]:
    """Axes above each other, or beside each other."""
    with picture(file, (10.0, height), {"figure.dpi": 110, "font.size": 10}) as figure:
        yield figure.subplots(rows, columns, sharex="col")


def _thin(result: Result, step: int = 10) -> slice:
    return slice(None, None, max(1, min(step, len(result.time) // 2000 or 1)))


def contact_errors(result: Result) -> tuple[Array, Array]:
    """Times [s] and errors [N m] of the controller's valid values of C_t."""
    ground = result.telemetry["GROUND"]
    valid = ground["valid"] > 0
    time = ground["time"][valid]
    return time, ground["torque"][valid] - result.truth["contact_torque"][np.round(time * 1000).astype(int)]


def ground_torque(result: Result, sand_at: float, calibrated_at: float, file: Path) -> Path:
    """Speed, swing, and C_t with its band against the truth, from the floor onto the sand."""
    with _panels(file, 7.5, 3) as (top, middle, low):
        cut = _thin(result)
        truth, ground = result.truth, result.telemetry["GROUND"]
        top.plot(result.time[cut], truth["speed"][cut], color=BLUE)
        top.set_ylabel("axle speed, m/s")
        middle.plot(result.time[cut], np.degrees(truth["swing_angle"][cut]), color=GREY)
        middle.set_ylabel("swing, degrees")
        low.plot(result.time[cut], 1e3 * truth["contact_torque"][cut], color=GREY, lw=0.8, label="truth")
        valid = ground["valid"] > 0
        low.errorbar(
            ground["time"][valid][::10],
            1e3 * ground["torque"][valid][::10],
            2e3 * ground["torque_sd"][valid][::10],
            fmt=".",
            ms=3,
            lw=0.8,
            color=BLUE,
            label="controller, valid, ± 2 sd",
        )
        low.set(
            ylabel="$C_t$, mN m",
            ylim=(-20, 1.4e3 * float(np.median(truth["contact_torque"][-1000:]))),
            xlabel="time, s",
        )
        low.legend(loc="upper left")
        for axis in (top, middle, low):
            axis.axvline(calibrated_at, color=GREEN, lw=1, ls=":")
            axis.axvspan(sand_at, result.time[-1], color="#e7c77b", alpha=0.25, lw=0)
        top.text(calibrated_at, top.get_ylim()[1], " calibrated", color=GREEN, va="top")
        top.text(sand_at, top.get_ylim()[1], " sand", color="#8a6a14", va="top")
    return file


def slip_limiter(limited: Result, free: Result, file: Path) -> Path:
    """Slip while a carriage slows the axle, with and without the limiter."""
    with _panels(file, 5.5, 2) as (top, low):
        for result, color, label in ((free, RED, "without limiter"), (limited, BLUE, "with limiter")):
            cut = _thin(result)
            top.plot(result.time[cut], result.truth["slip"][cut], color=color, label=label)
            low.plot(result.time[cut], 0.08 * result.truth["omega"][cut], color=color, label=f"rim, {label}")
        low.plot(limited.time, limited.truth["speed"], color=GREY, label="axle, imposed")
        top.axhline(0.5, color=GREY, lw=0.8, ls="--")
        top.set(ylabel="slip", ylim=(0.0, 1.0), xlim=(1.0, limited.time[-1]))
        top.legend(loc="upper left")
        low.set(ylabel="speed, m/s", xlabel="time, s")
        low.legend(loc="upper right")
    return file


def slope(limited: Result, free: Result, file: Path) -> Path:
    """A slope too steep to climb, with and without the limiter."""
    with _panels(file, 7.0, 3) as (top, middle, low):
        for result, color, label in ((free, RED, "without limiter"), (limited, BLUE, "with limiter")):
            cut = _thin(result)
            rolling = np.abs(0.08 * result.truth["omega"][cut]) > 0.02
            top.plot(result.time[cut], result.truth["position"][cut], color=color, label=label)
            middle.plot(result.time[cut], np.where(rolling, result.truth["slip"][cut], np.nan), color=color, lw=0.9)
            low.plot(result.time[cut], result.truth["rut"][cut], color=color)
        top.set_ylabel("way, m")
        top.legend(loc="upper left")
        middle.axhline(0.5, color=GREY, lw=0.8, ls="--")
        middle.set(ylabel="slip", ylim=(-1.05, 1.05))
        low.set(ylabel="rut depth, 0 to 1", xlim=(0.0, 12.0), xlabel="time, s")  # nothing moves after that
    return file


def forced_slip(
    slip: Array, measured: dict[str, Array], curves: Sequence[tuple[str, Array, dict[str, Array]]], file: Path
) -> Path:
    """Measured traction and torque against slip, and what the models say; curves are (label, slip, channels)."""
    with _panels(file, 4.2, 1, 2) as axes:
        for axis, channel, unit in zip(axes, ("traction", "torque"), ("N", "N m"), strict=True):
            for (label, at, values), color in zip(curves, (GREY, BLUE, GREEN), strict=False):
                axis.plot(at, values[channel], color=color, label=label)
            axis.plot(slip, measured[channel], "o", color=RED, label="measured")
            axis.set(xlabel="slip, 1 - r/R", ylabel=f"{channel}, {unit}", ylim=(0.0, None))
        axes[0].legend(loc="best")
    return file


def heated(temperature: Array, before: Array, after: Array, errors: Sequence[tuple[str, Result]], file: Path) -> Path:
    """Residuals in noise sd against the winding's temperature before and after, and the controller's error of C_t."""
    with _panels(file, 4.2, 1, 2) as (left, right):
        left.axhspan(-1.0, 1.0, color=GREEN, alpha=0.12, lw=0, label="noise, ± 1 sd")
        left.plot(temperature, before, ".", color=RED, label="model without the effect")
        left.plot(temperature, after, ".", color=BLUE, label="with motor_heating")
        left.set(xlabel="winding, °C", ylabel="residual of the current, noise sd")
        left.legend(loc="best")
        for (label, result), color in zip(errors, (RED, BLUE), strict=True):
            time, error = contact_errors(result)
            right.plot(time, 1e3 * error, ".", ms=3, color=color, label=label)
        right.axhline(0.0, color=GREY, lw=0.8)
        right.set(xlabel="time, s", ylabel="controller's error of $C_t$, mN m")
        right.legend(loc="best")
    return file
