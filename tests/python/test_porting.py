"""The core as a module of Zephyr and a library of PlatformIO: the files that west and PlatformIO read, what they build.

Neither tool is run: Zephyr's CMake functions are stood in for, and PlatformIO's filter is applied to the archive.
"""

from __future__ import annotations

import fnmatch
import json
import re
import shutil
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = """\
cmake_minimum_required(VERSION 3.22)
project(application LANGUAGES C)
set(CONFIG_TERRAPIN y)
add_library(zephyr_interface INTERFACE)
target_compile_definitions(zephyr_interface INTERFACE __ZEPHYR__)
add_library(app STATIC main.c)
function(zephyr_link_libraries)
    target_link_libraries(app ${ARGN})
endfunction()
function(zephyr_include_directories)
    target_include_directories(app PRIVATE ${ARGN})
endfunction()
add_subdirectory(terrapin/zephyr module)
"""
MAIN = """\
#include <terrapin.h>
#include <terrapin_interface.h>
static uint64_t memory[TERRAPIN_STATE_BYTES / 8];
void start(void);
void start(void) {
    terrapin_init((terrapin_state *)memory);
}
"""


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("release")
    command = [str(ROOT / "tests/tools/release.sh"), str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    with tarfile.open(done.stdout.strip()) as archive:
        archive.extractall(folder, filter="data")
    (tree,) = (path for path in folder.iterdir() if path.is_dir())
    return tree


def test_the_module_says_what_west_asks(unpacked: Path) -> None:
    """name, build.cmake (a folder with CMakeLists.txt), build.kconfig (a file), as Zephyr's schema has them."""
    text = (unpacked / "zephyr" / "module.yml").read_text()
    fields = dict(re.findall(r"^\s*(\w+):[ ]*(\S*)$", text, re.MULTILINE))
    assert set(fields) == {"name", "build", "cmake", "kconfig"}
    assert fields["name"] == "terrapin"
    assert (unpacked / fields["cmake"] / "CMakeLists.txt").is_file()
    assert (unpacked / fields["kconfig"]).read_text().startswith("config TERRAPIN\n\tbool ")
    assert (ROOT / "zephyr" / "module.yml").read_text() == text  # west takes the repository too


def test_the_module_builds_in_an_application(unpacked: Path, tmp_path: Path) -> None:
    (tmp_path / "CMakeLists.txt").write_text(PROJECT)
    (tmp_path / "main.c").write_text(MAIN)
    (tmp_path / "terrapin").symlink_to(unpacked)
    for words in (["-S", ".", "-B", "build"], ["--build", "build"]):
        done = subprocess.run(["cmake", *words], cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def library(tree: Path) -> dict[str, Any]:
    return dict(json.loads((tree / "library.json").read_text()))


def test_the_library_says_what_platformio_asks(unpacked: Path) -> None:
    """Required: name (at most 100 characters, none of :@/), version, description, license; headers that are there."""
    found = library(unpacked)
    assert re.fullmatch(r"[^:@/;]{1,100}", found["name"])
    version = re.search(r"project\(terrapin VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())
    assert version
    assert found["version"] == version[1]
    assert found["license"] == "Apache-2.0"
    assert len(found["description"]) <= 255
    assert found["frameworks"] == found["platforms"] == "*"
    folders = [unpacked / flag.removeprefix("-I") for flag in found["build"]["flags"]]
    for header in found["headers"]:
        assert any((folder / header).is_file() for folder in folders)


@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="arm-none-eabi-gcc not installed")
def test_the_library_compiles_for_a_bare_cortex_m(unpacked: Path, tmp_path: Path) -> None:
    build = library(unpacked)["build"]
    chosen: set[Path] = set()
    everything = set(unpacked.rglob("*.c"))
    for sign, pattern in re.findall(r"([+-])<([^>]*)>", " ".join(build["srcFilter"])):
        found = {
            p for p in everything if fnmatch.fnmatch(p.relative_to(unpacked / build["srcDir"]).as_posix(), pattern)
        }
        chosen = chosen | found if sign == "+" else chosen - found
    assert len(chosen) == len(list((ROOT / "firmware/core").glob("*.c"))) + 1
    (tmp_path / "main.c").write_text(MAIN + "int main(void) {\n    start();\n    return 0;\n}\n")
    chip = ["-mcpu=cortex-m0plus", "-mthumb", "-Os", "-ffunction-sections", "-Wl,--gc-sections", "--specs=nosys.specs"]
    command = [
        "arm-none-eabi-gcc",
        "-std=c11",
        *chip,
        *build["flags"],
        *map(str, sorted(chosen)),
        str(tmp_path / "main.c"),
    ]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "firmware.elf")],
        cwd=unpacked, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
