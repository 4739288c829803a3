"""Keys in PEM files: what is read, what is refused, and who may read what is written."""

from __future__ import annotations

import hashlib
import os
import stat
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from terrapin_hil.reading import ReadingError
from terrapin_tools.errors import UserError
from terrapin_tools.flash.keys import (
    development_key,
    key_hash,
    key_in,
    new_key,
    private_key,
    public_key,
    public_text,
    write_new,
    write_secret,
)

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
PEM, PKCS8, INFO = (
    serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.PublicFormat.SubjectPublicKeyInfo
)  # fmt: skip


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a slip takes a key's text for its name, the file does not lie in the sources."""
    monkeypatch.chdir(tmp_path)


def _private(path: Path, key: Ed25519PrivateKey | ec.EllipticCurvePrivateKey, password: bytes = b"") -> Path:
    how = serialization.BestAvailableEncryption(password) if password else serialization.NoEncryption()
    write_secret(path, key.private_bytes(PEM, PKCS8, how))
    return path


def test_a_private_key_is_read_and_its_public_one(tmp_path: Path) -> None:
    path = _private(tmp_path / "key.pem", KEY)
    raw = KEY.public_key().public_bytes_raw()
    assert private_key(path).private_bytes_raw() == bytes(range(32))
    assert public_key(path).public_bytes_raw() == raw
    write_new(tmp_path / "public.pem", public_text(KEY.public_key()))
    assert public_key(tmp_path / "public.pem").public_bytes_raw() == raw
    with pytest.raises(UserError, match=r"public\.pem: a public key, expected the private one"):
        private_key(tmp_path / "public.pem")
    made = new_key(tmp_path / "new.pem")
    assert private_key(tmp_path / "new.pem").public_key().public_bytes_raw() == made.public_bytes_raw() != raw


@pytest.mark.parametrize("private", [True, False])
def test_another_kind_of_key_is_none(tmp_path: Path, private: bool) -> None:
    other, path = ec.generate_private_key(ec.SECP256R1()), tmp_path / "key.pem"
    if private:
        _private(path, other)
    else:
        write_new(path, other.public_key().public_bytes(PEM, INFO))
    for read in (private_key, public_key):
        with pytest.raises(UserError, match="found another kind of key, expected Ed25519"):
            read(path)


def test_what_is_no_key_or_has_a_password_is_refused(tmp_path: Path) -> None:
    locked = _private(tmp_path / "locked.pem", KEY, b"secret")
    write_new(tmp_path / "none.pem", b"-----BEGIN PUBLIC KEY-----\nno\n-----END PUBLIC KEY-----\n")
    for path in (locked, tmp_path / "none.pem"):
        with pytest.raises(UserError, match="expected an Ed25519 key in PEM without a password"):
            public_key(path)
    with pytest.raises(UserError, match="No such file or directory; `terrapin keys new` makes one"):
        public_key(tmp_path / "absent.pem")
    with pytest.raises(UserError, match=r"cannot read the key: Is a directory$"):
        public_key(tmp_path)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o601])
def test_a_private_key_that_others_may_read_is_refused(tmp_path: Path, mode: int) -> None:
    path = _private(tmp_path / "key.pem", KEY)
    path.chmod(mode)
    with pytest.raises(ReadingError, match=f"mode 0{mode:o}"):
        private_key(path)
    public = tmp_path / "public.pem"
    write_new(public, public_text(KEY.public_key()))
    public.chmod(mode)
    public_key(public)


def test_a_key_is_written_for_its_owner_alone_and_never_replaced(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        write_secret(tmp_path / "secret", b"1")
        write_new(tmp_path / "open", b"2")
        os.umask(0)
        new_key(tmp_path / "new.pem")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("secret", "open", "new.pem")]
    assert modes == [0o600, 0o644, 0o600]
    for name in ("secret", "open"):
        with pytest.raises(UserError, match="exists already; a key is never replaced"):
            write_new(tmp_path / name, b"3")
    assert (tmp_path / "open").read_bytes() == b"2"
    with pytest.raises(UserError, match="cannot write the key: No such file or directory"):
        write_secret(tmp_path / "absent" / "key", b"1")


def test_a_part_of_a_key_does_not_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("terrapin_tools.flash.keys.os.fchmod", full)
    with pytest.raises(UserError, match="cannot write the key: No space left on device"):
        write_secret(tmp_path / "key.pem", b"1")
    assert list(tmp_path.iterdir()) == []


def test_a_key_is_found_by_its_name_wherever_it_stands() -> None:
    """The name is the digest of its SubjectPublicKeyInfo."""
    raw, named = KEY.public_key().public_bytes_raw(), key_hash(KEY.public_key())
    info = KEY.public_key().public_bytes(serialization.Encoding.DER, INFO)
    assert named == hashlib.sha256(info).digest()
    for data in (raw, b"x" + raw, raw + b"x", bytes(100) + raw + bytes(7)):
        found = key_in(data, named)
        assert found is not None
        assert found.public_bytes_raw() == raw
    for data in (b"", raw[:31], raw[1:] + raw[:1], bytes(64)):
        assert key_in(data, named) is None


def test_what_stands_in_the_way_of_a_key_is_named_for_its_owner_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also before its mode is set: nobody may open it in between."""
    modes: list[int] = []

    def fchmod(handle: int, mode: int) -> None:
        modes.append(stat.S_IMODE(os.fstat(handle).st_mode))

    monkeypatch.setattr("terrapin_tools.flash.keys.os.fchmod", fchmod)
    before = os.umask(0)
    try:
        write_secret(tmp_path / "key.pem", b"1")
    finally:
        os.umask(before)
    assert modes == [0o600]


def test_the_key_of_the_bench_is_where_the_build_put_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "bench.pem"
    monkeypatch.setattr("terrapin_hil.paths.development_key", lambda: place)
    with pytest.raises(
        UserError, match=r"--key: no development key in .*bench\.pem; `terrapin keys new KEY\.pem` makes"
    ):
        development_key()
    _private(place, KEY)
    assert development_key() == place
