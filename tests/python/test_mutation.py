"""The mutation gate itself: which slips it makes, that it sees what a test sees, and that its list is kept honest."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_hil.paths import ROOT
from tests.mutation import __main__ as gate
from tests.mutation import python as of_python
from tests.mutation.judge import Bench, NotReady
from tests.mutation.neighbours import further
from tests.mutation.operators import Mutant, mutants
from tests.mutation.python import judge, passes, rooms, slips
from tests.mutation.warm import record

SOURCE = """#include "a.h"

enum {
    MOST = 3
};

/* a < b */
static int32_t least(const int32_t *value, uint32_t count) {
    TERRAPIN_ASSERT(count > 0U);
    int32_t found = value[0];
    for (uint32_t i = 1U; i < count; i++) {
        if (*value <= -found) {
            found = value[i] - 1;
        }
    }
    return found;
}
"""


def test_the_slips_of_a_function(tmp_path: Path) -> None:
    (tmp_path / "a.c").write_text(SOURCE)
    found = {(m.function, m.change) for m in mutants(Path("a.c"), tmp_path)}
    assert found == {
        ("enum", "3 -> 4"), ("enum", "3 -> 2"),
        ("least", "0 -> 1"), ("least", "1U -> 2U"), ("least", "1U -> 0U"), ("least", "< -> <="), ("least", "< -> >="),
        ("least", "++ -> --"), ("least", "<= -> <"), ("least", "<= -> >"), ("least", "- -> +"), ("least", "1 -> 2"),
        ("least", "1 -> 0"), ("least", "(*value <= -found) -> (!(*value <= -found))"),
        ("least", "found = value[i] - 1; -> ;"),
    }  # fmt: skip
    for mutant in mutants(Path("a.c"), tmp_path):
        assert mutant.text() != SOURCE
        assert mutant.text().count("\n") == SOURCE.count("\n")  # assertions name the same lines
        assert mutant.line in SOURCE


NEIGHBOURS = """#include "a.h"

static const uint8_t table[2] = {7U, 0x10U};

static int32_t larger(pair *p, const int32_t *value, uint32_t at) {
    if ((p->left > 0) && p->good) {
        p->count = least(value, at, 3U);
    }
    return (p->left > p->right) ? p->left : value[at];
}
"""


def test_the_slips_of_one_who_looks_at_the_wrong_line(tmp_path: Path) -> None:
    folder = tmp_path / "firmware" / "core"
    folder.mkdir(parents=True)
    (folder / "a.c").write_text(NEIGHBOURS)
    (folder / "a.h").write_text(
        "typedef struct {\n    int32_t left, right;\n    bool good;\n    uint32_t count;\n} pair;\n"
    )
    found = {(m.function, m.change) for m in further(Path("firmware/core/a.c"), tmp_path)}
    assert found == {
        ("table", "7U -> 8U"), ("table", "7U -> 6U"), ("table", "0x10U -> 0x11U"), ("table", "0x10U -> 0xFU"),
        ("larger", "left -> right"), ("larger", "left -> right (number 2)"), ("larger", "right -> left"),
        ("larger", "(p->left > 0) && -> nothing"), ("larger", "&& p->good -> nothing"),
        ("larger", "((p->left > 0) && p->good) -> (0)"), ("larger", "((p->left > 0) && p->good) -> (1)"),
        ("larger", "value, at -> at, value"), ("larger", "at, 3U -> 3U, at"),
        ("larger", "p->left : value[at] -> value[at] : p->left"), ("larger", "at -> (at) + 1"),
    }  # fmt: skip
    for mutant in further(Path("firmware/core/a.c"), tmp_path):
        assert mutant.text().count("\n") == NEIGHBOURS.count("\n")


def test_the_slips_of_a_module() -> None:
    text = (
        'def larger(a: int, b: int = 1) -> int:\n    """Words."""\n    if a > b and not empty(a, b):\n'
        "        seen[0] = max(a, b) - 2\n        raise ValueError(f'{a + 1}')\n    return a\n"
    )
    found = {(s.old, s.new) for s in slips("a.py", text)}
    assert found == {
        ("a > b and not empty(a, b)", "True"), ("a > b and not empty(a, b)", "False"), ("a > b", "(a >= b)"),
        ("a > b and not empty(a, b)", "(not empty(a, b))"), ("a > b and not empty(a, b)", "(a > b)"),
        ("a > b and not empty(a, b)", "(a > b or not empty(a, b))"), ("not empty(a, b)", "(empty(a, b))"),
        ("empty(a, b)", "(empty(b, a))"), ("0", "(1)"), ("max(a, b)", "(min(a, b))"),
        ("max(a, b) - 2", "(max(a, b) + 2)"), ("2", "(3)"), ("seen[0] = max(a, b) - 2", "pass"),
        ("raise ValueError(f'{a + 1}')", "pass"),
    }  # fmt: skip
    for slip in slips("a.py", text):
        compile(text[: slip.begin] + slip.new + text[slip.end :], "a.py", "exec")


def test_every_room_has_its_modules_and_tests() -> None:
    for room in rooms():
        assert room.modules, room.name
        assert room.tests, room.name
        assert all((ROOT / test.partition(" -k ")[0]).is_file() for test in room.tests), room.name


def test_the_list_of_equivalent_slips_in_python_is_kept_honest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    everything = of_python.everything()
    assert of_python.listed(everything)[1] == []
    one = everything[0]
    entry = f"[[equivalent]]\nfile = {one.path!r}\nfunction = {one.function!r}\n"
    for change, why, words in (("5 -> 6", "so", "matches no slip"), (one.change, "", "gives no reason")):
        (tmp_path / "list.toml").write_text(f"{entry}change = '''{change}'''\nwhy = {why!r}\n")
        monkeypatch.setattr(of_python, "EQUIVALENT", tmp_path / "list.toml")
        assert words in of_python.listed(everything)[1][0]


def test_a_slip_is_run_with_the_tests_that_call_it() -> None:
    """In a fork that has imported everything else; the module itself is on pytest's command line, for its doctests."""
    path = "host_tools/terrapin_tools/workbench/files/units.py"
    runs = [["tests/python/test_units.py", "-k", "coherent or factorial", path]]
    known = record(runs, [path])
    assert [name.partition("::")[2] for name, test in known.items() if f"{path} in_si" in test.calls] == [
        "test_the_coherent_unit_of_the_same_kind"
    ]
    every = slips(path, (ROOT / path).read_text(encoding="utf-8"))
    seen = next(s for s in every if s.function == "in_si" and s.change == "1.0 -> (2.0)")
    killer = "tests/python/test_units.py::test_the_coherent_unit_of_the_same_kind"
    assert judge(seen, runs, known) == judge(seen, runs, {}) == ("killed", killer)
    assert passes(killer)
    same = of_python.Slip(path, seen.line, seen.function, seen.begin, seen.end, seen.old, f"({seen.old})")
    assert judge(same, runs, known) == ("survived", "")


def test_a_process_sees_the_mutant_in_place_of_the_module(tmp_path: Path) -> None:
    """And leaves no compiled text of it behind."""
    (tmp_path / "told.py").write_text("ANSWER = 1\n")
    (tmp_path / "mutant.json").write_text(json.dumps([str((tmp_path / "told.py").resolve()), "ANSWER = 2\n"]))
    inside = str(ROOT / "tests" / "mutation" / "inside")
    environment = {"PYTHONPATH": os.pathsep.join([inside, str(tmp_path)]), "PATH": os.environ["PATH"]}
    said = []
    for planted in ({"TERRAPIN_MUTANT": str(tmp_path / "mutant.json")}, {}):
        command = [sys.executable, "-c", "import told; print(told.ANSWER)"]
        done = subprocess.run(command, env={**environment, **planted}, capture_output=True, text=True, check=True)
        said.append(done.stdout.strip())
    assert said == ["2", "1"]


def test_of_a_change_the_check_takes_a_part_of_them() -> None:
    everything = {k: m for k, m in gate.everything().items() if m.path.as_posix() == "firmware/core/slip.c"}
    chosen = gate.a_part_of_the_further(everything, 1)
    plain = {m.name for m in mutants(Path("firmware/core/slip.c"), ROOT)}
    old = sum(m.name in plain for m in everything.values())
    assert old < len(chosen) <= 1.16 * old + 1  # and so the time of make check is at most 1.2 times what it was
    assert set(chosen) == set(gate.a_part_of_the_further(everything, 1))
    assert set(chosen) != set(gate.a_part_of_the_further(everything, 2))


def test_every_function_of_the_firmware_has_some() -> None:
    by_file = {m.path.as_posix() for m in gate.everything().values()}
    assert by_file == {
        p.relative_to(ROOT).as_posix()
        for part in gate.LIBRARIES.values()
        for p in ROOT.glob(part)
        if gate.seen_by_a_test(p.relative_to(ROOT))
    } - set(gate.NOT_IN_IMAGES)
    ports = {name for name in by_file if name.startswith("firmware/ports/")}
    assert {name.rpartition("/")[2] for name in ports} >= {
        "controller.c",
        "bridge.c",
        "hardware.c",
        "gpio_v2.c",
        "port.c",
    }
    chosen = gate.sample(gate.everything(), 1)
    assert len(chosen) >= 1000
    for name in gate.LIBRARIES:
        assert sum(gate.library(m) == name for m in chosen.values()) >= 150


def test_the_list_of_equivalents_is_kept_honest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    everything = gate.everything()
    assert gate.listed(everything)[1] == []
    one = next(iter(everything.values()))
    entry = f"file = {one.path.as_posix()!r}\nfunction = {one.function!r}\nline = '''{one.line}'''\n"
    for change, why, words in (("5 -> 6", "so", "matches no mutant"), (one.change, "", "gives no reason")):
        (tmp_path / "list.toml").write_text(f"[[equivalent]]\n{entry}change = {change!r}\nwhy = {why!r}\n")
        monkeypatch.setattr(gate, "EQUIVALENT", tmp_path / "list.toml")
        assert words in gate.listed(everything)[1][0]
    (tmp_path / "list.toml").write_text(
        "".join(
            f"[[equivalent]]\nfile = {m.path.as_posix()!r}\nfunction = {m.function!r}\nline = '''{m.line}'''\n"
            f"change = '''{m.change}'''\nwhy = 'so'\n"
            for m in [m for m in everything.values() if m.path == one.path and "'" not in m.line][:40]
        )
    )
    assert "expected at most 5%" in gate.listed(everything)[1][0]


def test_what_was_judged_is_kept_by_function(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As long as the function's text is what it was; a survivor as long as the tests are."""
    place = tmp_path / "firmware" / "core"
    place.mkdir(parents=True)
    text = "void one(int *a) {\n    *a = 1;\n}\n\nvoid two(int *a) {\n    *a = 2;\n}\n"
    (place / "a.c").write_text(text)
    monkeypatch.setattr(gate, "ROOT", tmp_path)
    monkeypatch.setattr(gate, "KEPT", tmp_path / "judged.txt")
    found = gate.everything()
    assert len(found) == 6
    verdicts = ["killed", "survived", "equal", "invalid", "killed", "survived"]
    done = {
        k: {"key": k, "verdict": v, "by": "", "tests": "now" if i < 5 else "then"}
        for i, (k, v) in enumerate(zip(found, verdicts, strict=True))
    }
    gate.keep(found, done, "now")
    again = gate.kept(gate.everything())
    assert [again[k]["verdict"] for k in found if k in again] == verdicts[:5]
    assert {e["tests"] for e in again.values()} == {"now"}
    (place / "a.c").write_text(text.replace("*a = 2", "*a = 5"))
    assert {k.split()[2] for k in gate.kept(gate.everything())} == {"one:"}


def test_changed_functions_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "firmware" / "core"
    place.mkdir(parents=True)
    text = "void one(int *a) {\n    *a = 1;\n}\n\nvoid two(int *a) {\n    *a = 2;\n}\n"
    (place / "a.c").write_text(text)
    for folder in ("link", "store", "boot", "ports"):
        (tmp_path / "firmware" / folder).mkdir()
        (tmp_path / "firmware" / folder / "keep.txt").write_text("")
    for words in (["init", "-q"], ["add", "."], ["-c", "user.name=a", "-c", "user.email=a", "commit", "-qm", "a"]):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    (place / "a.c").write_text(text.replace("*a = 2", "*a = 5"))
    monkeypatch.setattr(gate, "ROOT", tmp_path)
    found = gate.changed(gate.everything(), "HEAD")
    assert {m.function for m in found.values()} == {"two"}
    assert {m.change for m in found.values()} == {"5 -> 6", "5 -> 4", "*a = 5; -> ;"}


def test_what_a_test_sees_is_killed_and_unseen_when_it_is_switched_off() -> None:
    """One slip that takes the e-stop away, with the supervisor's tests and without any."""
    line = "causes |= fault_bit(TERRAPIN_FAULT_ESTOP);"
    slip = next(m for m in mutants(Path("firmware/core/supervisor.c"), ROOT) if m.line == line and m.old == line)
    same = Mutant(slip.path, slip.source, slip.begin, slip.old, " " + slip.old, slip.function)
    start = "calibration_start(state);"  # which a test sees that includes the file
    unseen = next(m for m in mutants(Path("firmware/core/supervisor.c"), ROOT) if m.old == start)
    bad = Mutant(slip.path, slip.source, slip.begin, slip.old, "causes |= ;", slip.function)
    others = ["test_[!c]*", "test_core_[!s]*", "test_core_step*", "test_codec*", "scenarios", "tests/boot"]
    try:
        with Bench(others) as bench:
            assert bench.judge(slip) == ("killed", "test_core_supervisor_blackbox")
            assert bench.judge(same) == ("equal", "")
            assert bench.judge(bad) == ("invalid", "")
            assert bench.judge(unseen) == ("killed", "test_core_supervisor_whitebox")
            bench._order = {slip.path.as_posix(): []}  # switched off
            assert bench.judge(slip) == ("survived", "")
    except NotReady as error:
        pytest.skip(str(error))
