"""Images: the same bytes as imgtool's, taken by imgtool and by the boot loader, refused when anything is wrong."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from bootlib import START, library
from bootlib import Chip as _Chip
from cryptography.hazmat.primitives import serialization
from kit import KEY, NEXT_KEY, NEXT_PUBLIC, OTHER_KEY, PUBLIC, code, image

from terrapin_hil.messages import interface
from terrapin_tools.flash.image import ImageError, Version, parse, sign, verify
from terrapin_tools.flash.layout import BASE, SLOTS


def imgtool(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(Path(sys.executable).with_name("imgtool")), *arguments], capture_output=True, text=True, check=False
    )


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "key.pem"
    path.touch(0o600)
    path.write_bytes(
        KEY.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return path


def by_loader(data: bytes, slot: str = "a") -> str:
    """What the boot loader says of these bytes in a slot."""
    chip = _Chip(PUBLIC)
    chip.put(slot, data)
    _, lib = library()
    image_ = chip.ffi.new("terrapin_image *")
    area = chip.ffi.new("terrapin_flash_area *", (START[slot], 0x20000))
    chip.ffi.memmove(image_, b"\xa5" * chip.ffi.sizeof("terrapin_image"), chip.ffi.sizeof("terrapin_image"))
    number = lib.terrapin_image_verify(chip.flash, area[0], BASE + START[slot], chip.keys, image_)
    assert number or image_.key == 0, "the first key, whatever stood there"
    return next(name for name, value in interface().enums["update_result"].items() if value == number)


@pytest.mark.parametrize("slot", ["a", "b"])
def test_the_same_bytes_as_imgtool(slot: str, key_file: Path, tmp_path: Path) -> None:
    body = tmp_path / "code.bin"
    body.write_bytes(code(slot, 5000))
    out = tmp_path / "imgtool.bin"
    done = imgtool(
        "sign", "-k", str(key_file), "-v", "1.2.3+4", "-s", "7", "-H", "0x200", "--pad-header", "-S", "0x20000",
        "-F", hex(SLOTS[slot]), "--align", "4", str(body), str(out),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    own = sign(body.read_bytes(), KEY, Version(1, 2, 3, 4), 7, slot)
    assert own == out.read_bytes()
    assert by_loader(out.read_bytes(), slot) == "ok"
    mine = tmp_path / "own.bin"
    mine.write_bytes(own)
    verified = imgtool("verify", "-k", str(key_file), str(mine))
    assert verified.returncode == 0
    assert "correctly validated" in verified.stdout
    assert "1.2.3+4" in verified.stdout


def test_what_an_image_says() -> None:
    found = parse(image("b", "3.4.5+6", counter=9, size=1000))
    assert (found.version, found.slot, found.security_counter) == (Version(3, 4, 5, 6), "b", 9)
    assert found.code_size == 1000
    verify(found, KEY.public_key())
    with pytest.raises(ImageError, match="another key"):
        verify(found, OTHER_KEY.public_key())


def test_loader_and_host_name_the_same_reason() -> None:
    good = image("a", "1.0.0")
    tlvs = len(good) - 144
    unsigned = bytearray(good[: tlvs + 40])
    unsigned[tlvs + 2 : tlvs + 4] = (40).to_bytes(2, "little")
    flipped = bytearray(good)
    flipped[0x200 + 99] ^= 1
    forged = bytearray(good)
    forged[-1] ^= 1
    assert by_loader(good) == "ok"
    assert by_loader(image("b", "1.0.0")) == "wrong_slot"
    assert by_loader(image("a", "1.0.0", key=OTHER_KEY)) == "wrong_key"
    assert by_loader(bytes(unsigned)) == "bad_signature"
    assert by_loader(bytes(flipped)) == "corrupted"
    assert by_loader(bytes(forged)) == "bad_signature"
    assert by_loader(good[:-1] + b"\xff") == "bad_signature"
    assert by_loader(b"\xff" * 100) == "not_an_image"
    for data, reason in [(unsigned, "not signed"), (flipped, "corrupted"), (forged, "forged")]:
        with pytest.raises(ImageError, match=reason):
            verify(parse(bytes(data)), KEY.public_key())
    for data in (good[:-1], good[:700], good[:20], good + b"more"):
        with pytest.raises(ImageError):
            parse(bytes(data))


@pytest.mark.parametrize("slot", ["a", "b"])  # behind b the flash that it serves ends
def test_largest_and_too_large(slot: str) -> None:
    overhead = len(image(slot, "1.0.0", size=600)) - 600
    largest = image(slot, "1.0.0", size=0x20000 - overhead)
    assert len(largest) == 0x20000
    assert by_loader(largest, slot) == "ok"
    with pytest.raises(ImageError, match="bytes of code"):
        image(slot, "1.0.0", size=0x20000 - overhead + 1)


@pytest.mark.parametrize(("offset", "value"), [
    (4, 0x08020004), (8, 0x100), (12, 0xFFFFFFF0), (12, 0x1FFFF), (12, 0), (16, 0), (16, 0x120), (10, 0), (10, 0xFFFF),
])  # fmt: skip
def test_headers_that_lie_about_sizes(offset: int, value: int) -> None:
    data = bytearray(image("a", "1.0.0"))
    width = 2 if offset in (8, 10) else 4
    data[offset : offset + width] = value.to_bytes(width, "little")
    assert by_loader(bytes(data)) in ("not_an_image", "wrong_slot")


def test_sign_never_writes_over_what_it_reads(key_file: Path, tmp_path: Path) -> None:
    """Neither the code nor the key, under whatever name."""
    body = tmp_path / "code.bin"
    body.write_bytes(code("a", 900))
    (tmp_path / "same.bin").symlink_to(body)
    (tmp_path / "hard.bin").hardlink_to(body)
    before = [path.read_bytes() for path in (body, key_file)]
    program = [sys.executable, "-c", "from terrapin_tools.cli import main; main()", "image", "sign"]
    for to, what in [
        (body, "code"),
        (tmp_path / "same.bin", "code"),
        (tmp_path / "hard.bin", "code"),
        (key_file, "key"),
    ]:
        done = subprocess.run(
            [*program, body, to, "--version", "1.0.0", "--key", key_file], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout) == (2, "")
        assert f"{to}: is the {what} itself; expected another name" in done.stderr
        assert [path.read_bytes() for path in (body, key_file)] == before
    done = subprocess.run(
        [*program, body, tmp_path / "no" / "x", "--version", "1.0.0", "--key", key_file],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, "cannot write" in done.stderr) == (2, True)


# ---------------------------------------------------------------- kinds of images, and where a release takes them

MARK = b"terrapin-kind\0\0\0"
PRODUCTION = MARK + b"\1\0\0\0"
UNIT = 0x1234ABCD


def of_kind(mark: bytes, unit: int | None = None) -> bytes:
    body = code("a", 600)
    return sign(body[:300] + mark + body[300 + len(mark) :], KEY, Version(1, 0, 0), 1, "a", unit)


@pytest.mark.parametrize(
    ("mark", "unit", "bench", "release"),
    [
        (PRODUCTION, None, "ok", "ok"),
        (MARK + b"\0\0\0\0", None, "ok", "desk_image"),
        (b"", None, "ok", "desk_image"),
        (MARK + b"\0\0\0\0", UNIT, "ok", "ok"),
        (MARK + b"\0\0\0\0", UNIT ^ 1, "ok", "desk_image"),
        (PRODUCTION, UNIT ^ 1, "ok", "ok"),
    ],
)
def test_a_release_takes_a_desk_image_only_when_it_names_the_chip(
    mark: bytes, unit: int | None, bench: str, release: str
) -> None:
    data = of_kind(mark, unit)
    found = parse(data)
    assert (found.kind, found.unit) == ("production" if mark == PRODUCTION else "desk", unit)
    for is_release, expected in ((False, bench), (True, release)):
        chip = _Chip(PUBLIC)
        chip.boot.release, chip.boot.unit = is_release, UNIT
        chip.put("a", data)
        assert chip.check("a") == expected
        assert chip.start() == ("a" if expected == "ok" else "")


def test_kind_and_unit_are_signed() -> None:
    data = of_kind(MARK + b"\0\0\0\0", UNIT)
    for old, new in ((b"\xa1\0\4\0" + UNIT.to_bytes(4, "little"), b"\xa1\0\4\0\0\0\0\0"),):
        assert data.count(old) == 1
        assert by_loader(data.replace(old, new)) == "corrupted"


def test_the_release_build_wants_a_public_key_of_its_own(tmp_path: Path) -> None:
    from terrapin_hil import paths

    program = paths.ROOT / "firmware" / "boot" / "boot_key.py"
    private, public = tmp_path / "robot.pem", tmp_path / "robot.pub.pem"
    private.write_bytes(
        KEY.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    public.write_bytes(
        KEY.public_key().public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)
    )
    following, disguised = tmp_path / "next.pub.pem", tmp_path / "disguised.pub.pem"
    for path, key in ((following, NEXT_KEY), (disguised, OTHER_KEY)):
        path.write_bytes(
            key.public_key().public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)
        )
    bench = tmp_path / "development.pem"
    bench.write_bytes(disguised.read_bytes())

    def make(key: Path, *options: str) -> tuple[int, str]:
        out = tmp_path / "boot_key.h"
        done = subprocess.run(
            [sys.executable, str(program), "--key", str(key), "--out", str(out), *options],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        return done.returncode, done.stderr

    assert make(public, "--release") == (0, "")
    assert "TERRAPIN_BOOT_RELEASE true" in (tmp_path / "boot_key.h").read_text()
    assert make(public, "--release", "--bench", str(bench), "--next", str(following)) == (0, "")
    digits = re.findall(r"0x([0-9A-F]{2})U", (tmp_path / "boot_key.h").read_text())
    assert bytes.fromhex("".join(digits)) == PUBLIC + NEXT_PUBLIC
    for key, options, expected in (
        (private, ("--release",), "a private key"),
        (bench, ("--release",), "the key of the bench"),
        (public, ("--release", "--make"), "the key of the bench"),
        (disguised, ("--release", "--bench", str(bench)), "the key of the bench"),
        (public, ("--release", "--bench", str(bench), "--next", str(disguised)), "disguised.pub.pem: the key of the"),
        (public, ("--release", "--next", str(private)), "robot.pem: a private key"),
        (public, ("--release", "--next", str(public)), "the same key as"),
        (public, ("--next", str(private)), "the same key as"),
        (tmp_path / "none.pem", ("--release",), "No such file"),
    ):
        status, said = make(key, *options)
        assert status == 1
        assert expected in said
