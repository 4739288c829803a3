"""Steps of `make test` and `make check`, where the checkout is reached through a symbolic link."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[1] / "tools"

PROJECT = """cmake_minimum_required(VERSION 3.16)
project(counted C)
add_compile_options(--coverage -O0)
add_link_options(--coverage)
add_executable(counted counted.c)
"""
STEP = f"""import sys
from pathlib import Path
sys.path.insert(0, {str(TOOLS)!r})
from steps import run
here = Path.cwd().resolve()
commands = (["cmake", "-S", ".", "-B", "build"], ["cmake", "--build", "build"], ["build/counted"],
            ["gcovr", "--root", ".", "--json-summary", "report.json", "build"])
result = run("counted", *commands, cwd=here)
print(result.output)
sys.exit(not result.passed)
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
def test_gcovr_names_files_by_their_place_in_a_checkout_behind_a_link(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.mkdir()
    link.symlink_to(real)
    (real / "CMakeLists.txt").write_text(PROJECT)
    (real / "counted.c").write_text("int main(void) { return 0; }\n")
    script = [
        "sh",
        "-c",
        'cd "$0" && exec "$1" -c "$2"',
        str(link),
        sys.executable,
        STEP,
    ]  # as a shell: PWD is the link
    done = subprocess.run(script, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (file,) = json.loads((real / "report.json").read_text())["files"]
    assert file["filename"] == "counted.c"
    assert file["line_percent"] == 100.0
