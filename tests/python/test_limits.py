"""[limits]: what the rig can set, in canonical units, and one clear line for what is wrong in it."""

from __future__ import annotations

from pathlib import Path

import pytest
from casekit import ROLLING, one_line, rolling, terrapin

from terrapin_tools.workbench.case.case import load_case


def _with(limits: str) -> str:
    return ROLLING + "\n[limits]\n" + limits + "\n"


def test_limits_arrive_in_canonical_units(tmp_path: Path) -> None:
    text = _with(
        'omega = { min = 30, max = 60, unit = "rpm" }\nload = { min = "1 kgf", max = 40 }\n'
        'temperature = { min = "32 degF", max = "310 K", unit = "degC" }\nslope = { min = 0, max = 10, unit = "deg" }\n'
        "humidity = { min = 0, max = 1 }"
    )
    limits = load_case(rolling(tmp_path, 1, text=text)).limits
    assert limits["omega"] == pytest.approx((3.14159265, 6.2831853))
    assert limits["load"] == pytest.approx((9.80665, 40.0))
    assert limits["temperature"] == pytest.approx((0.0, 36.85), abs=1e-9)
    assert limits["slope"] == pytest.approx((0.0, 0.17453293))  # a role that no column measures yet
    assert limits["humidity"] == (0.0, 1.0)
    assert load_case(rolling(tmp_path / "none", 1)).limits == {}


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ("omega = 5", ["case.toml:30", "limits.omega", "found 5", "{ min = , max = , unit = }"]),
        ("omega = { min = 1 }", ["case.toml:30", "limits.omega.max", "missing"]),
        ("omega = { min = 2, max = 1 }", ["case.toml:30", "limits.omega", "min below max"]),
        ("omega = { min = 1, max = 1 }", ["case.toml:30", "limits.omega", "min below max"]),
        ("omega = { min = nan, max = 1 }", ["case.toml:30", "limits.omega.min", "finite"]),
        ('omega = { min = "fast", max = 1 }', ["case.toml:30", "limits.omega.min", "'fast'"]),
        ('omega = { min = 0, max = "9 N" }', ["case.toml:30", "limits.omega.max", "'N'", "rad/s"]),
        ('omega = { min = 0, max = 1, unit = "kg" }', ["case.toml:30", "limits.omega.unit", "kg", "rad/s"]),
        ("omega = { min = 0, max = 1, units = 1 }", ["case.toml:30", "limits.omega.units", "min, max, unit"]),
        ("w = { min = 0, max = 1 }", ["case.toml:30", "limits.w", "its role omega"]),
        ("current = { min = 0, max = 1 }", ["case.toml:30", "limits.current", "no role"]),
        ("\nwarp = { min = 0, max = 1 }", ["case.toml:31", "limits.warp", "no role", "humidity"]),
        ('humidity = { min = 0, max = 1, unit = "kg" }', ["case.toml:30", "limits.humidity.unit", "not mapped"]),
    ],
)
def test_one_line_for_wrong_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], limits: str, expected: list[str]
) -> None:
    folder = rolling(tmp_path, 1, text=_with(limits))
    status, out, err = terrapin(capsys, "compare", folder)
    assert (status, out) == (2, "")
    one_line(err, expected)
