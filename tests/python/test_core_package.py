"""The core in a stranger's project: program and CMake lines of docs/embedding.md, on this machine and for a chip."""

import json
import os
import re
import shutil
import subprocess
import tarfile
from hashlib import sha256
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "embedding.md").read_text(encoding="utf-8")
FETCH, SUBDIRECTORY, FIND = re.findall(r"```cmake\n(.*?)```", PAGE, re.DOTALL)
(PROGRAM,) = re.findall(r"```c\n(.*?)```", PAGE, re.DOTALL)
(OUTPUT,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
LINES = {"fetch": FETCH, "subdirectory": SUBDIRECTORY, "repository": SUBDIRECTORY, "find": FIND}
# The stranger's own: targets whose names this project uses too, an older standard of C, and a warning.
PROJECT = """\
cmake_minimum_required(VERSION 3.22)
project(stranger LANGUAGES C)
set(CMAKE_C_STANDARD 99)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
foreach(name core interface unity boot_key terrapin)
    add_library(${name} INTERFACE)
endforeach()
add_executable(mine main.c unused.c)
target_compile_options(mine PRIVATE -Wall)
"""
UNUSED = "int unused(void);\nint unused(void) {\n    int nobody_reads_this;\n    return 0;\n}\n"
TOOLCHAIN = """\
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 -ffunction-sections -fdata-sections")
set(CMAKE_EXE_LINKER_FLAGS_INIT "--specs=nosys.specs -Wl,--gc-sections")
"""
CHIP = pytest.param(
    "chip", marks=pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="arm-none-eabi-gcc not installed")
)


def run(*command: str | Path, cwd: Path | None = None, **variables: str) -> str:
    done = subprocess.run(
        command, cwd=cwd, env={**os.environ, **variables}, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("release")
    return Path(run(ROOT / "tests/tools/release.sh", out).strip())


@pytest.fixture(scope="module")
def unpacked(archive: Path) -> Path:
    with tarfile.open(archive) as file:
        file.extractall(archive.parent / "unpacked", filter="data")
    (tree,) = (archive.parent / "unpacked").iterdir()
    return tree


@pytest.fixture(scope="module")
def place(unpacked: Path) -> Path:
    """Where the release is installed for this machine."""
    return install(unpacked, unpacked.parent.parent / "host")


def install(source: Path, folder: Path, *options: str) -> Path:
    """Installed as the page says; without Python, which a release does not need."""
    run("cmake", "-S", source, "-B", folder / "build", "-DCMAKE_DISABLE_FIND_PACKAGE_Python3=ON", *options)
    run("cmake", "--build", folder / "build")
    run("cmake", "--install", folder / "build", "--prefix", folder / "place")
    return folder / "place"


def own_lines(project: Path, machine: str) -> list[str]:
    """Options of the stranger for a machine."""
    if machine == "host":
        return ["-DCMAKE_BUILD_TYPE=Release"]
    (project / "toolchain.cmake").write_text(TOOLCHAIN)
    return ["-DCMAKE_BUILD_TYPE=MinSizeRel", f"-DCMAKE_TOOLCHAIN_FILE={project / 'toolchain.cmake'}"]


@pytest.mark.parametrize("machine", ["host", CHIP])
@pytest.mark.parametrize("way", LINES)
def test_a_stranger_links_the_core(way: str, machine: str, archive: Path, unpacked: Path, tmp_path: Path) -> None:
    project = tmp_path / "stranger"
    project.mkdir()
    options = own_lines(project, machine)
    if way == "fetch":
        shutil.copy(archive, project)
    elif way == "subdirectory":
        shutil.copytree(unpacked, project / "terrapin")
    elif way == "repository":
        (project / "terrapin").mkdir()
        shutil.copy(ROOT / "CMakeLists.txt", project / "terrapin")
        shutil.copytree(ROOT / "firmware", project / "terrapin/firmware")
    else:
        options.append(f"-DCMAKE_PREFIX_PATH={install(unpacked, tmp_path, *options)}")
    if way != "repository":  # which generates its C
        options.append("-DCMAKE_DISABLE_FIND_PACKAGE_Python3=ON")
    (project / "CMakeLists.txt").write_text(PROJECT + LINES[way])
    (project / "main.c").write_text(PROGRAM)
    (project / "unused.c").write_text(UNUSED)
    build = project / "build"

    run("cmake", "-S", project, "-B", build, *options)
    run("cmake", "--build", build)
    if machine == "host":
        assert run(build / "mine") == OUTPUT
    else:
        assert re.search(r" T terrapin_step_drive$", run("arm-none-eabi-nm", build / "mine"), re.MULTILINE)

    # Nothing of ours but the core is compiled, and with nobody's flags but theirs.
    commands = {Path(c["file"]).name: c["command"] for c in json.loads((build / "compile_commands.json").read_text())}
    core = {path.name for path in (ROOT / "firmware/core").glob("*.c")} | {"terrapin_interface.c"}
    assert set(commands) == {"main.c", "unused.c"} | (set() if way == "find" else core)
    assert not [name for name, command in commands.items() if re.search(r" -W(?!all)| -DTERRAPIN| -fsan", command)]
    include = re.search(r"-(?:I|isystem )(\S+)", commands["main.c"])
    assert include
    assert {path.name for path in Path(include[1]).iterdir()} == {"terrapin.h", "terrapin_interface.h"}


def test_at_most_four_lines() -> None:
    assert [len(lines.splitlines()) for lines in (FETCH, SUBDIRECTORY, FIND)] == [4, 2, 2]


def test_the_core_of_another_robot(tmp_path: Path) -> None:
    """The archive was the cylinder's, whatever `make release ROBOT=...` named."""
    assert 'release.sh build/release "my robot.toml"' in run("make", "-n", "release", "ROBOT=my robot.toml", cwd=ROOT)
    own = ROOT / "firmware/terrapin_interface/robots/sphere.toml"
    file = Path(shutil.copy(own, tmp_path / "mine.toml"))
    made = Path(run(ROOT / "tests/tools/release.sh", tmp_path / "out", file).strip())
    assert re.fullmatch(r"terrapin-core-mine-[0-9.]+\.tar\.gz", made.name)
    with tarfile.open(made) as archive:
        archive.extractall(tmp_path, filter="data")
    tree = tmp_path / made.name.removesuffix(".tar.gz")
    assert (tree / "generated/robot.toml").read_bytes() == own.read_bytes()

    project = tmp_path / "project"
    (project / "terrapin").mkdir(parents=True)
    shutil.copy(ROOT / "CMakeLists.txt", project / "terrapin")
    shutil.copytree(ROOT / "firmware", project / "terrapin/firmware")
    shutil.copy(file, project)
    (project / "main.c").write_text(PROGRAM)
    (project / "unused.c").write_text(UNUSED)
    chosen = "set(TERRAPIN_ROBOT mine.toml)\n" + SUBDIRECTORY
    (project / "CMakeLists.txt").write_text(PROJECT + chosen)
    run("cmake", "-S", project, "-B", project / "build")
    header = (project / "build/terrapin/include/terrapin_interface.h").read_bytes()
    assert header == (tree / "generated/terrapin_interface.h").read_bytes()

    shutil.rmtree(project / "terrapin")
    shutil.copytree(tree, project / "terrapin")
    again = ["cmake", "-S", project, "-B", tmp_path / "again"]
    refused = subprocess.run(again, capture_output=True, text=True, check=False)
    assert refused.returncode
    assert "expected none with a release" in " ".join(refused.stderr.split())


def test_the_program_stops_and_says_whose_it_is(place: Path, tmp_path: Path) -> None:
    """A STOP_ALL on its bus puts the bridge off, IDENTITY_READ is answered, and a value out of range starts nothing."""
    sending = "static void can_send(const terrapin_frame *frame) {\n"
    shown = '    if (frame->id == TERRAPIN_ID_IDENTITY) { puts("IDENTITY"); }\n'
    assert PROGRAM.count(sending) == 1
    text = PROGRAM.replace("int main(void)", "int program(void)").replace(sending, sending + shown)
    (tmp_path / "program.c").write_text(text)
    (tmp_path / "main.c").write_text(
        """#include "program.c"
int main(void) {
    const terrapin_frame stop = {.id = TERRAPIN_ID_STOP_ALL, .length = 1};
    const terrapin_frame who = {.id = TERRAPIN_ID_IDENTITY_READ, .length = 1};
    if (program() != 0 || !outputs.enable) {
        return 1;
    }
    take(&who);
    take(&stop);
    millisecond();
    if (outputs.enable || (outputs.faults & (1U << TERRAPIN_FAULT_STOP_ALL)) == 0) {
        return 2;
    }
    for (int i = 0; i < 1000; i++) { /* whoever goes on with RUN */
        millisecond();
    }
    return outputs.enable ? 3 : 0;
}
"""
    )
    flags = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-I", place / "include")
    library = next(place.rglob("*.a"))
    run("cc", *flags, tmp_path / "main.c", library, "-o", tmp_path / "stops")
    assert run(tmp_path / "stops").splitlines().count("IDENTITY") == 1

    (tmp_path / "out.c").write_text(PROGRAM.replace("VOLTAGE_LIMIT, 9000", "VOLTAGE_LIMIT, 90000"))
    run("cc", *flags, tmp_path / "out.c", library, "-o", tmp_path / "out")
    assert subprocess.run([tmp_path / "out"], capture_output=True, check=False).returncode == 1


def test_pkg_config(place: Path, tmp_path: Path) -> None:
    if not shutil.which("pkg-config"):
        pytest.skip("pkg-config not installed")
    (tmp_path / "main.c").write_text(PROGRAM)
    (line,) = re.findall(r"^cc .*pkg-config.*$", PAGE, re.MULTILINE)
    (file,) = place.rglob("terrapin-core.pc")
    moved = tmp_path / "moved"  # the place may be moved afterwards
    shutil.copytree(place, moved)
    run("sh", "-c", line, cwd=tmp_path, PKG_CONFIG_PATH=str(moved / file.parent.relative_to(place)))
    assert run(tmp_path / "mine") == OUTPUT


@pytest.mark.parametrize(
    "compiler",
    [
        ["cc", "-std=c99", "-x", "c"],
        ["cc", "-std=c11", "-x", "c"],
        ["c++", "-std=c++11", "-x", "c++"],
        ["c++", "-std=c++20", "-x", "c++"],
    ],
    ids=lambda words: words[1].removeprefix("-std="),
)
@pytest.mark.parametrize("header", ["terrapin.h", "terrapin_interface.h"])
def test_headers_are_plain(compiler: list[str], header: str, place: Path, tmp_path: Path) -> None:
    if not shutil.which(compiler[0]):
        pytest.skip(f"{compiler[0]} not installed")
    file = tmp_path / "a"
    file.write_text(f'#include "{header}"\nunsigned size(void);\nunsigned size(void) {{ return TERRAPIN_TICK_HZ; }}\n')
    strict = ["-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    run(*compiler, *strict, "-I", place / "include", file)


def test_the_example_in_the_header_compiles(place: Path, tmp_path: Path) -> None:
    """It needed a header that it did not name, and had words between its lines."""
    top = (place / "include" / "terrapin.h").read_text(encoding="utf-8").partition("*/")[0]
    lines = [line.removeprefix(" *     ") for line in top.splitlines() if line.startswith(" *     ")]
    (tmp_path / "example.c").write_text("\n".join(lines) + "\nint main(void) { at_the_start(); each_millisecond(); }\n")
    flags = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I", place / "include")
    run("cc", *flags, tmp_path / "example.c", next(place.rglob("*.a")), "-o", tmp_path / "example")
    run(tmp_path / "example")


def test_size_of_a_state_is_a_constant(place: Path, tmp_path: Path) -> None:
    """The same on this machine and on the chip, and what the header says."""
    file = tmp_path / "size.c"
    file.write_text(
        '#include "state.h"\nconst char takes[sizeof(terrapin_state)] = {1};\n'
        "const char says[TERRAPIN_STATE_BYTES] = {1};\n"
    )
    folders = ["-I", ROOT / "firmware/core", "-I", place / "include"]
    machines = [("", ["-m64"] if os.uname().machine == "x86_64" else [])]
    if shutil.which("arm-none-eabi-gcc"):
        machines.append(("arm-none-eabi-", ["-mcpu=cortex-m4"]))
    sizes = set()
    for prefix, options in machines:
        run(f"{prefix}gcc", *options, *folders, "-c", file, "-o", tmp_path / "size.o")
        words = run(f"{prefix}nm", "-S", tmp_path / "size.o")
        sizes |= {int(size, 16) for size in re.findall(r"^\w+ (\w+) . (?:takes|says)$", words, re.MULTILINE)}
    assert len(sizes) == 1


def test_the_archive_is_the_same_each_time(archive: Path, unpacked: Path, tmp_path: Path) -> None:
    copy = tmp_path / "elsewhere"  # other times, another mask
    for name in ("CMakeLists.txt", "LICENSE", "firmware", "zephyr", "docs/embedding.md", "tests/tools/release.sh"):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copyfile)(ROOT / name, copy / name)
    run("sh", "-c", "umask 077; bash tests/tools/release.sh out", cwd=copy)
    assert (copy / "out" / archive.name).read_bytes() == archive.read_bytes()

    with tarfile.open(archive) as file:
        names = file.getnames()
    assert names == sorted(names)
    digest, name = (unpacked / "controller.toml.sha256").read_text().split()
    assert digest == sha256((ROOT / "firmware/terrapin_interface" / name).read_bytes()).hexdigest()


def test_one_version(archive: Path) -> None:
    (version,) = re.findall(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert archive.name == f"terrapin-core-{version}.tar.gz"
    assert archive.name in FETCH
    assert f"find_package(terrapin {version.rpartition('.')[0]} " in FIND
