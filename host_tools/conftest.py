"""Examples in docstrings run in an empty folder, with the public names of terrapin_tools at hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(autouse=True)
def names(doctest_namespace: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import terrapin_tools
    from terrapin_hil import paths

    monkeypatch.chdir(tmp_path)
    public = {name: getattr(terrapin_tools, name) for name in terrapin_tools.__all__}
    doctest_namespace.update(public, terrapin=terrapin_tools, paths=paths)
