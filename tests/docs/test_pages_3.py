"""Every block of a quarter of the pages runs, in order, as tests/docs/pages.py says. Four files: cores share them."""

from pathlib import Path
from typing import Any

import pytest
from pages import PAGES, ROOT, Runner, blocks


@pytest.mark.parametrize("page", PAGES[2::4])
def test_blocks_run(page: str, tmp_path: Path, record_property: Any) -> None:
    runner = Runner(tmp_path / "terrapin")
    runner.page(blocks(page, (ROOT / page).read_text()))
    record_property("examples_ran", runner.ran)
    record_property("examples_hardware", runner.hardware)
