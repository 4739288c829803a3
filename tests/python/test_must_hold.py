"""Short forms of the campaigns in tests/campaigns: the same bounds, fewer voltages and seeds."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.campaigns import must_hold
from tests.campaigns.must_hold import Row


@pytest.mark.parametrize(
    "campaign",
    [
        pytest.param(lambda: must_hold.steady_ideal((2.0, 5.0, 8.0)), id="steady, ideal sensors"),
        pytest.param(lambda: must_hold.steady_real(20), id="steady, real sensors"),
        pytest.param(must_hold.carriage, id="carriage"),
        pytest.param(must_hold.slope, id="slope"),
        pytest.param(lambda: must_hold.determinism(2), id="determinism"),
    ],
)
def test_bounds_hold(campaign: Callable[[], list[Row]]) -> None:
    missed = [str(row) for row in campaign() if not row.met]
    assert missed == []
