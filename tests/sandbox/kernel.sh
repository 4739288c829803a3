#!/usr/bin/env bash
# The kernel of the sandbox: user-mode Linux (an ordinary program, no root) with CAN and simulated GPIO.
#
# kernel.sh find    prints the path of the kernel that stands in the cache; status 1 and the reason when there is none
# kernel.sh build   builds it there first when it is missing (Debian's packaged source, some minutes, once)
#
# The cache is ${XDG_CACHE_HOME:-~/.cache}/terrapin/uml/SOURCE_VERSION-KEY/linux; KEY is of configuration, patches and
# machine. A newer source version alone is no reason to build again.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
series=6.1 # the source package linux-source-6.1 (Debian 12)
limit=${TERRAPIN_KERNEL_LIMIT:-3600} # s for the compiler: six minutes of a processor, on a busy machine ten times that
cache=${XDG_CACHE_HOME:-$HOME/.cache}/terrapin/uml
key=$(cat "$here/kernel/config" "$here"/kernel/*.patch <(uname -m) | sha256sum | cut -c1-12)

say() { printf '%s\n' "$*" >&2; }
fail() {
    say "sandbox kernel: $*"
    exit 1
}

find_kernel() {
    local kernel
    for kernel in "$cache/$series".*-"$key"/linux; do
        [ -x "$kernel" ] && printf '%s\n' "$kernel" && return
    done
    return 1
}

check_tools() {
    local tool missing=()
    [ "$(uname -m)" = x86_64 ] || fail "needs x86-64, this is $(uname -m)"
    for tool in apt-get apt-cache dpkg-deb flex bison bc m4 make gcc patch xz flock timeout; do
        command -v "$tool" >/dev/null || missing+=("$tool")
    done
    [ ${#missing[@]} = 0 ] || fail "not built: needs ${missing[*]}"
}

# source VERSION FOLDER: Debian's source of that version, without the drivers that this configuration cannot choose
unpack() {
    local version=$1 folder=$2 part excluded=()
    (cd "$folder" && apt-get -q -o Acquire::Retries=2 -o Acquire::http::Timeout=60 download "linux-source-$series=$version") \
        >>"$folder/log" 2>&1 || fail "cannot download linux-source-$series=$version: $(tail -n 1 "$folder/log")"
    dpkg-deb -x "$folder"/linux-source-*.deb "$folder/deb"
    for part in drivers/gpu drivers/media drivers/net/ethernet drivers/net/wireless drivers/scsi drivers/staging \
        drivers/infiniband sound Documentation; do
        excluded+=("--exclude=*/$part/*.[chS]" "--exclude=*/$part/*.rst" "--exclude=*/$part/*.yaml" "--exclude=*/$part/*.svg")
    done
    mkdir "$folder/source"
    tar -x --xz -f "$folder"/deb/usr/src/linux-source-*.tar.xz -C "$folder/source" --strip-components=1 "${excluded[@]}"
    rm -rf "$folder/deb" "$folder"/linux-source-*.deb
}

# compile FOLDER: make, with a line of progress now and then; its words are in FOLDER/log
compile() {
    local folder=$1 patch pid start=$SECONDS shown=0
    cp "$here/kernel/config" "$folder/source/arch/um/configs/terrapin_defconfig"
    for patch in "$here"/kernel/*.patch; do
        patch -s -p1 -d "$folder/source" <"$patch" >>"$folder/log" 2>&1 || fail "${patch##*/} does not fit: $(tail -n 3 "$folder/log")"
    done
    (
        cd "$folder/source"
        timeout 120 make ARCH=um "O=$folder/out" terrapin_defconfig
        exec timeout -k 10 "$limit" make ARCH=um "O=$folder/out" "-j$(nproc)" linux
    ) >>"$folder/log" 2>&1 </dev/null &
    pid=$!
    while kill -0 "$pid" 2>/dev/null; do
        if [ $((SECONDS - start - shown)) -ge 30 ]; then
            shown=$((SECONDS - start))
            say "sandbox kernel: $(grep -c '^ *CC ' "$folder/log" || true) files compiled after $shown s"
        fi
        sleep 1
    done
    wait "$pid" || fail "the build failed (limit $limit s): $(grep -m 1 -iE 'error|fehler' "$folder/log" || tail -n 1 "$folder/log")"
}

build_kernel() {
    local version folder start=$SECONDS
    check_tools
    mkdir -p "$cache"
    exec 8>"$cache/lock"
    flock -w $((limit + 300)) 8 || fail "another build of it did not end"
    find_kernel && return # the other build's
    version=$(apt-cache policy "linux-source-$series" | sed -n 's/^ *Candidate: //p')
    [ -n "$version" ] && [ "$version" != "(none)" ] || fail "not built: apt knows no package linux-source-$series"
    folder=$(mktemp -d "${TMPDIR:-/tmp}/terrapin-kernel.XXXXXX")
    # shellcheck disable=SC2064 # the folder of now
    trap "rm -rf '$folder'" EXIT
    say "sandbox kernel: building linux-source-$series $version, once; some minutes"
    unpack "$version" "$folder" 8>&-
    compile "$folder" 8>&-
    strip "$folder/out/linux"
    mkdir -p "$cache/$version-$key"
    cp "$folder/out/.config" "$cache/$version-$key/config"
    mv "$folder/out/linux" "$cache/$version-$key/linux.part"
    mv "$cache/$version-$key/linux.part" "$cache/$version-$key/linux"
    say "sandbox kernel: built in $((SECONDS - start)) s"
    printf '%s\n' "$cache/$version-$key/linux"
}

case ${1:-} in
find) find_kernel || fail "not built; run \`make sandbox\`" ;;
build) find_kernel || build_kernel ;;
*) fail "find or build" ;;
esac
