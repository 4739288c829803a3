#!/usr/bin/env bash
# unity.sh   prints the folder that holds Unity (unity.c, unity.h); status 1 and one line when it cannot be had.
# Looked for in $UNITY_ROOT, in the system's places, in the user's cache, then fetched into that cache from the package mirrors
# that this machine's apt is set up with: Debian's package cmock (it carries Unity), or the sources of ntpsec (they too).
# apt itself verifies signatures and checksums; its lists and packages stay in a temporary folder, so no root is needed.
set -euo pipefail
cd "$(dirname "$0")/../.."
. tests/setup/system.sh
cache=${XDG_CACHE_HOME:-$HOME/.cache}/terrapin/unity

for place in ${UNITY_ROOT:+"$UNITY_ROOT" "$UNITY_ROOT/src"} /usr/share/cmock/vendor/unity/src /usr/src/unity/src /usr/src/unity "$cache"; do
    if [ -f "$place/unity.c" ] && [ -f "$place/unity.h" ] && [ -f "$place/unity_internals.h" ]; then
        printf '%s\n' "$place"
        exit 0
    fi
done
command -v apt-get >/dev/null || fail "Unity not found, and no apt here to fetch it: set UNITY_ROOT to its folder"

. tests/setup/mirror.sh

# keep FOLDER: the three files and the licence go into the cache in one move.
keep() {
    mkdir -p "$(dirname "$cache")"
    mkdir "$work/keep"
    cp "$1/unity.c" "$1/unity.h" "$1/unity_internals.h" "$work/keep/"
    find "$1/.." -maxdepth 1 -name 'LICENSE*' -exec cp {} "$work/keep/" \;
    rm -rf "$cache"
    mv "$work/keep" "$cache"
    printf '%s\n' "$cache"
    exit 0
}

from_package() { # LINE
    with_source "deb $1" update && with_source "deb $1" download cmock || return 1
    dpkg-deb -x "$work"/out/cmock_*.deb "$work/tree" && keep "$work/tree/usr/share/cmock/vendor/unity/src"
}

from_source() { # LINE
    with_source "deb-src $1" update && with_source "deb-src $1" source --download-only ntpsec || return 1
    mkdir -p "$work/tree" && tar -xf "$work"/out/ntpsec_*.orig.tar.* -C "$work/tree" --strip-components=1 || return 1
    keep "$work/tree/tests/unity"
}

say "fetching Unity (the C tests' assertions) from this machine's package mirror"
try() { # SOURCE MIRROR
    from_package "$1" || from_package "$2 trixie main" || from_source "$1"
}
each_source try
tail -n 5 "$work/log" >&2 || true
fail "Unity could not be fetched: set UNITY_ROOT to its folder (unity.c, unity.h, unity_internals.h)"
