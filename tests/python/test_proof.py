"""What the proofs stand on: the models do what the C does, and each proof sees the defects that are planted for it."""

from __future__ import annotations

import os
import random
import subprocess
from pathlib import Path
from typing import Any

import cffi
import pytest

from terrapin_hil.paths import ROOT
from tests.proof import __main__ as proof
from tests.proof import models

POINTS = 1_000_000
DECLARED = """
uint32_t tie_digit(uint32_t *rest, uint32_t next, uint32_t d);
int32_t integer_ratio_tie(int32_t value, int32_t divisor);
int32_t integer_scale(int32_t value, int32_t factor, int32_t divisor);
int64_t integer_divide(int64_t numerator, int64_t denominator);
"""
WRAPPED = """#include "integer.c"
uint32_t tie_digit(uint32_t *rest, uint32_t next, uint32_t d) { return digit(rest, next, d); }
int32_t integer_ratio_tie(int32_t value, int32_t divisor) { return integer_ratio(value, divisor); }
"""


@pytest.fixture(scope="module")
def arithmetic(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("tie")
    (folder / "tie.c").write_text(WRAPPED)
    command = ["cc", "-std=c11", "-O2", "-shared", "-fPIC", "-DTERRAPIN_ASSERTIONS", f"-I{ROOT / 'firmware/core'}"]
    subprocess.run([*command, str(folder / "tie.c"), "-o", str(folder / "tie.so")], check=True, timeout=300)
    ffi = cffi.FFI()
    ffi.cdef(DECLARED)
    return ffi, ffi.dlopen(str(folder / "tie.so"))


def drawn(rng: random.Random, most: int) -> int:
    """A number of any size from 0 to most; now and then one at an end of a word."""
    bits = rng.randrange(most.bit_length() + 1)
    value = rng.getrandbits(bits) if bits and rng.random() < 0.9 else (1 << bits) - rng.randrange(2)
    return min(most, value)


def test_the_models_are_what_the_c_does(arithmetic: Any) -> None:
    ffi, lib = arithmetic
    rng = random.Random(1)
    rest = ffi.new("uint32_t *")
    for _ in range(POINTS // 4):
        d = models.WORD // 2 + drawn(rng, models.WORD // 2 - 1)
        rest[0] = begin = drawn(rng, d - 1)
        following = drawn(rng, models.HALF - 1)
        assert (lib.tie_digit(rest, following, d), rest[0]) == models.digit(begin, following, d)
        value, factor = (rng.choice((-1, 1)) * drawn(rng, (1 << 31) - 1) for _ in range(2))
        divisor = max(1, drawn(rng, (1 << 31) - 1))
        assert lib.integer_scale(value, factor, divisor) == models.scale(value, factor, divisor)
        if abs(value) + divisor // 2 < 1 << 31:
            assert lib.integer_ratio_tie(value, divisor) == models.ratio(value, divisor)
        numerator = rng.choice((-1, 1)) * drawn(rng, (1 << 62) - 1)
        denominator = max(1, drawn(rng, models.MOST))
        assert lib.integer_divide(numerator, denominator) == models.divide(numerator, denominator)


def test_the_ends_of_products_and_quotients() -> None:
    """What prove_gains.c and prove_ground.c say of some: each grows with its factors, and falls with its divisor."""
    count = (628318530718 + 1024) // 2048  # an encoder's count of the wheel's turn [1e-5 urad]
    assert models.scale(count, 2000, 500000) >= 1
    assert models.scale(count, 500000, 500000) <= 0x1FFFFFFF
    assert models.scale(count, 5000, 1000000) >= 1
    assert models.scale(count, 200000, 1000000) <= 0x3FFFFFF
    assert models.scale(10000, 1000, 10000) >= 1
    assert models.scale(500000, 2000000, 2000) == 500000000
    assert models.scale(10000, 1000, 1000) == 10000
    assert models.scale(500000, 500000, 1000) == 250000000
    assert 40 * 2**25 < (largest := (4000000 * 1374390 + 2**16 >> 17) * 32) <= 1342177760  # prove_ground.c
    assert 1280000000 * largest + 2**31 >> 32 <= 400000144
    assert [models.scale(sign * 1000000, 256, 100) for sign in (-1, 1)] == [-2560000, 2560000]


def tied(folder: Path, contracts: str) -> subprocess.CompletedProcess[str]:
    """The functions of integer.h against these contracts, at POINTS draws each."""
    (folder / "integers.h").write_text(contracts)
    (folder / "tie_integers.c").write_text((ROOT / "tests/proof/tie_integers.c").read_text())
    flags = ["-std=gnu11", "-O2", f"-I{ROOT / 'firmware/core'}", f"-I{ROOT / 'tests/proof'}", "-DTERRAPIN_ASSERTIONS"]
    flags += ["-fsanitize=undefined", "-fno-sanitize-recover=undefined", f"-DPOINTS={POINTS}U"]
    for made, kind in (("real.o", ["-DREAL"]), ("contracts.o", [])):
        command = ["cc", *flags, *kind, "-c", "tie_integers.c", "-o", made]
        subprocess.run(command, cwd=folder, check=True, timeout=300)
    subprocess.run(["cc", *flags, "real.o", "contracts.o", "-o", "tie"], cwd=folder, check=True, timeout=300)
    return subprocess.run([folder / "tie"], capture_output=True, text=True, check=False, timeout=600)


def test_the_functions_keep_to_their_contracts(tmp_path: Path) -> None:
    done = tied(tmp_path, (ROOT / "tests/proof/integers.h").read_text())
    assert (done.returncode, done.stderr) == (0, "")
    asked = {name: int(count) for name, count, _ in map(str.split, done.stdout.splitlines())}
    assert len(asked) == 15
    assert min(asked.values()) > POINTS // 3  # the others were not asked as the contracts want it


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("const int64_t most = two_to(power, bits);", "const int64_t most = two_to(power, bits + 1U);"),
        ("(factor <= ((int64_t)1 << bits))", "(factor < ((int64_t)1 << bits))"),
        ("(result <= 65536)", "(result <= 65528)"),
    ],
)
def test_a_contract_that_is_not_kept_is_seen(tmp_path: Path, right: str, wrong: str) -> None:
    contracts = (ROOT / "tests/proof/integers.h").read_text()
    assert contracts.count(right) == 1
    assert tied(tmp_path, contracts.replace(right, wrong)).returncode == 1


def test_every_proof_has_defects_that_can_be_planted() -> None:
    for one in proof.PROOFS:
        source = (ROOT / "firmware" / one.source).read_text(encoding="utf-8")
        assert one.defects
        for right, wrong in one.defects:
            assert right in source, f"{one.source} no longer has {right!r}: plant another defect in tests/proof"
            assert right != wrong
    assert sum(len(one.defects) for one in proof.PROOFS) >= 10
    assert {path.stem for path in (ROOT / "tests/proof").glob("prove_*.c")} == {f"prove_{p.name}" for p in proof.PROOFS}


def test_a_proof_holds_and_its_defect_is_seen() -> None:
    """The quickest one; `make proof` and `python -m tests.proof --planted` do all."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "terrapin" / "cbmc"
    if not cache.is_dir():
        pytest.skip("CBMC is not here (make proof fetches it)")
    cbmc = proof.prover()
    assert cbmc is not None
    one = next(p for p in proof.PROOFS if p.name == "integer")
    assert proof.shown(cbmc, one)
    assert proof.noticed(cbmc, one)
