"""Ed25519 keys in PEM files: the private one signs images, the public one is compiled into the boot loader."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from terrapin_hil import paths
from terrapin_hil.reading import owner_alone
from terrapin_tools.errors import UserError

__all__ = [
    "development_key",
    "key_hash",
    "key_in",
    "new_key",
    "private_key",
    "public_key",
    "public_text",
    "write_new",
    "write_secret",
]

_INFO = bytes.fromhex("302a300506032b6570032100")  # what precedes the key in its SubjectPublicKeyInfo
PEM_LIMIT = 10_000  # bytes of a file that are looked at


def development_key() -> Path:
    """The key that the build made for the bench; a boot loader built without -DTERRAPIN_KEY knows it.

    UserError when there is none, as in an installed wheel.
    """
    path = paths.development_key()
    if not path.is_file():
        raise UserError(f"--key: no development key in {path}; `terrapin keys new KEY.pem` makes one")
    return path


def new_key(path: Path) -> Ed25519PublicKey:
    """Make a private key in `path`, readable to its owner alone. UserError when the file exists or cannot be made."""
    key = Ed25519PrivateKey.generate()
    text = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    write_secret(path, text)
    return key.public_key()


def public_text(key: Ed25519PublicKey) -> bytes:
    """A public key as PEM."""
    return key.public_bytes(serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo)


def write_secret(path: Path, text: bytes) -> None:
    """A new file that its owner alone may read. UserError when it exists or cannot be made."""
    write_new(path, text, 0o600)


def write_new(path: Path, text: bytes, mode: int = 0o644) -> None:
    """A new file of a key. UserError when it exists or cannot be made."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(handle, "wb") as file:
                os.fchmod(handle, mode)  # whatever the umask is
                file.write(text)
        except BaseException:  # a part of a key is none, and would stand in the next one's way
            path.unlink()
            raise
    except FileExistsError:
        raise UserError(f"{path}: exists already; a key is never replaced") from None
    except OSError as error:
        raise UserError(f"{path}: cannot write the key: {error.strerror}") from None


def _load(path: Path) -> Ed25519PrivateKey | Ed25519PublicKey:
    try:
        with path.open("rb") as file:
            text = file.read(PEM_LIMIT)
            if b"PRIVATE KEY" in text:
                owner_alone(path, file)
    except OSError as error:
        hint = "; `terrapin keys new` makes one" if isinstance(error, FileNotFoundError) else ""
        raise UserError(f"{path}: cannot read the key: {error.strerror}{hint}") from None
    try:
        key = (
            serialization.load_pem_private_key(text, None)
            if b"PRIVATE KEY" in text
            else serialization.load_pem_public_key(text)
        )
    except (ValueError, TypeError):
        raise UserError(f"{path}: expected an Ed25519 key in PEM without a password") from None
    if not isinstance(key, Ed25519PrivateKey | Ed25519PublicKey):
        raise UserError(f"{path}: found another kind of key, expected Ed25519")
    return key


def private_key(path: Path) -> Ed25519PrivateKey:
    """The private key in a PEM. UserError when there is none, or when others may read it."""
    key = _load(path)
    if not isinstance(key, Ed25519PrivateKey):
        raise UserError(f"{path}: a public key, expected the private one")
    return key


def public_key(path: Path) -> Ed25519PublicKey:
    """The public key in a PEM, or that of the private key in it. UserError when there is neither, or when others may
    read a private one."""
    key = _load(path)
    return key.public_key() if isinstance(key, Ed25519PrivateKey) else key


def key_hash(key: Ed25519PublicKey) -> bytes:
    """SHA-256 of the SubjectPublicKeyInfo: the name that images and boot loaders know the key by."""
    return hashlib.sha256(
        key.public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo)
    ).digest()


def key_in(data: bytes, named: bytes) -> Ed25519PublicKey | None:
    """The public key of that name among the bytes of a boot loader, 32 of which it is; None when it is not there."""
    for at in range(len(data) - 31):
        raw = data[at : at + 32]
        if hashlib.sha256(_INFO + raw).digest() == named:
            return Ed25519PublicKey.from_public_bytes(raw)
    return None
