"""Every block of every page runs, in order, as tests/docs/pages.py says. The cores share the pages, not this file."""

from pathlib import Path
from typing import Any

import pytest
from pages import PAGES, ROOT, Runner, blocks


@pytest.mark.parametrize("page", PAGES)
def test_blocks_run(page: str, tmp_path: Path, record_property: Any) -> None:
    runner = Runner(tmp_path / "terrapin")
    runner.page(blocks(page, (ROOT / page).read_text()))
    record_property("examples_ran", runner.ran)
    record_property("examples_hardware", runner.hardware)
