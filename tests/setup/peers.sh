#!/usr/bin/env bash
# peers.sh   prints the folder that holds the sources of libfixmath and CMSIS-DSP, which tests/bench/bench_arithmetic.py
#            compiles beside the core's arithmetic; status 1 and one line when one of them cannot be had.
# Kept in the user's cache. libfixmath is Debian's source package, CMSIS-DSP is in the source archive of PyPI's cmsisdsp.
set -euo pipefail
cd "$(dirname "$0")/../.."
. tests/setup/system.sh
cache=${XDG_CACHE_HOME:-$HOME/.cache}/terrapin/peers
if [ -d "$cache" ]; then
    printf '%s\n' "$cache"
    exit 0
fi
command -v apt-get >/dev/null || fail "libfixmath cannot be fetched: no apt here"
. tests/setup/mirror.sh

unpacked() { # NAME ARCHIVE
    mkdir -p "$work/keep/$1"
    tar -xf "$2" -C "$work/keep/$1" --strip-components=1
}

libfixmath() { # SOURCE
    # The archive of its authors alone: what Debian adds is not needed, and a mirror may lack it.
    with_source "deb-src $1" update && { with_source "deb-src $1" source --download-only libfixmath || true; } &&
        unpacked libfixmath "$work"/out/libfixmath_*.orig.tar.*
}

say "fetching the sources of libfixmath and CMSIS-DSP"
each_source libfixmath || fail "libfixmath cannot be fetched: $(tail -n 1 "$work/log")"
(cd "$work/out" && "$OLDPWD/.venv/bin/python" -m pip download --no-deps --no-build-isolation --no-binary :all: \
    "cmsisdsp==1.10.3" >>"$work/log" 2>&1) || fail "cmsisdsp cannot be fetched: $(tail -n 1 "$work/log")"
unpacked cmsisdsp "$work"/out/cmsisdsp-*.tar.gz
mkdir -p "$(dirname "$cache")"
mv "$work/keep" "$cache"
printf '%s\n' "$cache"
