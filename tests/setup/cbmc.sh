#!/usr/bin/env bash
# cbmc.sh   prints the command that runs CBMC (a model checker for C); status 1 and one line when it cannot be had.
# Looked for on the PATH, in the user's cache, then fetched into that cache from Debian's mirror by apt, which verifies
# signatures and checksums: the package of Debian 13, with that release's C library beside it. No root is needed.
set -euo pipefail
cd "$(dirname "$0")/../.."
. tests/setup/system.sh
cache=${XDG_CACHE_HOME:-$HOME/.cache}/terrapin/cbmc

if command -v cbmc; then
    exit 0
fi
libraries=$cache/usr/lib/x86_64-linux-gnu
run="$libraries/ld-linux-x86-64.so.2 --library-path $libraries:$cache/usr/lib $cache/usr/bin/cbmc"
if [ ! -x "$cache/usr/bin/cbmc" ]; then
    [ "$(uname -m)" = x86_64 ] && command -v apt-get >/dev/null || fail "CBMC not found, and no apt of x86_64 here to fetch it"
    say "fetching CBMC from Debian's package mirror" >&2
    work=$(mktemp -d "${TMPDIR:-/tmp}/cbmc.XXXXXX")
    trap 'rm -rf "$work"' EXIT
    mkdir -p "$work/lists/partial" "$work/archives/partial" "$work/tree"
    keyring=/usr/share/keyrings/debian-archive-keyring.gpg
    mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | grep -v security | grep -m 1 '/debian/\?$') ||
        fail "CBMC not found, and no mirror of Debian here to fetch it from"
    printf 'deb [signed-by=%s] %s trixie main\n' "$keyring" "$mirror" >"$work/sources.list"
    touch "$work/status"
    options=(-q -o Dir::Etc::SourceList="$work/sources.list" -o Dir::Etc::SourceParts=/dev/null -o Dir::State::Lists="$work/lists"
        -o Dir::State::status="$work/status" -o Dir::Cache="$work" -o APT::Sandbox::User="$(id -un)" -o Acquire::Languages=none
        -o Acquire::Retries=2 -o Acquire::IndexTargets::deb::DEP-11::DefaultEnabled=false)
    (cd "$work" && timeout 300 apt-get "${options[@]}" update && timeout 300 apt-get "${options[@]}" download cbmc minisat libc6 libstdc++6 \
        libgcc-s1 zlib1g) >"$work/log" 2>&1 </dev/null || fail "CBMC could not be fetched: $(tail -n 1 "$work/log")"
    for package in "$work"/*.deb; do
        dpkg-deb -x "$package" "$work/tree"
    done
    mkdir -p "$(dirname "$cache")"
    rm -rf "$cache"
    mv "$work/tree" "$cache"
fi
$run --version >/dev/null || fail "CBMC does not run here"
printf '%s\n' "$run"
