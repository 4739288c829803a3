"""The public keys of the boot loader as C, from PEMs; makes the development key when there is none yet.

    boot_key.py --key KEY.pem [--next NEXT.pem] [--make] [--release --bench BENCH.pem] --out boot_key.h

KEY.pem holds an Ed25519 key, private or public; NEXT.pem the one that takes its place when it is revoked. With --make a
missing KEY.pem is made, private and readable to its owner alone: images that it signs are for the bench, and it never
leaves the build folder. With --release the files must hold public keys alone, two keys and none of them the bench's,
and the boot loader takes no desk image that does not name its chip.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from pathlib import Path

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey


def make(path: Path) -> None:
    """A new private key in `path`, unless it exists."""
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    text = Ed25519PrivateKey.generate().private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(text)
    try:
        os.link(temporary, path)  # never replaces the key of another build that was quicker
    except FileExistsError:
        pass
    finally:
        temporary.unlink()


def public(path: Path) -> bytes:
    """The 32 bytes of the public key in a PEM. ValueError when it is none of Ed25519."""
    text = path.read_bytes()
    private = b"PRIVATE KEY" in text
    key = serialization.load_pem_private_key(text, None) if private else serialization.load_pem_public_key(text)
    if isinstance(key, Ed25519PrivateKey):
        key = key.public_key()
    if not isinstance(key, Ed25519PublicKey):
        raise ValueError("no Ed25519 key")
    return key.public_bytes_raw()


def fit_for_release(path: Path, bench: Path | None) -> None:
    """ValueError when the key in a PEM must not be that of a robot which leaves the workshop."""
    if b"PRIVATE KEY" in path.read_bytes():
        raise ValueError("a private key, expected the public one alone: it must not lie beside a release build")
    if bench is not None and bench.is_file() and public(path) == public(bench):
        raise ValueError("the key of the bench, expected that of a release")


def main() -> int:
    parser = argparse.ArgumentParser(description="The boot loader's public keys as C.")
    parser.add_argument("--key", type=Path, required=True)
    parser.add_argument("--next", type=Path)
    parser.add_argument("--bench", type=Path)
    parser.add_argument("--make", action="store_true")
    parser.add_argument("--release", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    keys = []
    path = options.key
    try:
        if options.release and (options.make or path.name == "development.pem"):
            raise ValueError("the key of the bench, expected that of a release (-DTERRAPIN_KEY=PUBLIC.pem)")
        if options.make:
            make(path)
        for path in (options.key, options.next or options.key):
            if options.release:
                fit_for_release(path, options.bench)
            keys.append(public(path))
        if options.next and keys[0] == keys[1]:
            raise ValueError(f"the same key as {options.key}, expected the one that takes its place")
    except (OSError, ValueError, TypeError) as error:
        print(f"boot_key: {path}: {error}", file=sys.stderr)
        return 1
    info = bytes.fromhex("302a300506032b6570032100")  # before the key in its SubjectPublicKeyInfo (RFC 8410)
    digits = ", ".join(f"0x{byte:02X}U" for key in keys for byte in key)
    names = ", ".join(f"0x{int.from_bytes(hashlib.sha256(info + key).digest()[:4], 'little'):08X}U" for key in keys)
    options.out.write_text(
        "/* The public keys, one of which must have signed an image. Generated. */\n#include <stdint.h>\n"
        f"static const uint8_t terrapin_boot_keys[64] = {{{digits}}};\n"
        f"#define TERRAPIN_BOOT_KEY_IDS {{{names}}}\n"
        f"#define TERRAPIN_BOOT_RELEASE {'true' if options.release else 'false'}\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
