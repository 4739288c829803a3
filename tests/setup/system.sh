# Sourced by the set-up scripts: messages, logs, and packages of the system through apt.
# shellcheck shell=bash

LOGS=build/log

say() { printf '%s\n' "$*" >&2; }
fail() {
    say "setup: $*"
    exit 1
}

# one_at_a_time WAIT WHAT: holds this tree until the script ends, so that two runs of make do not write over each other.
# Waits for another run up to WAIT seconds. The lock is on a folder, so nothing is left behind; the system takes it back
# whatever ends the script. Where there is no flock (it comes with Linux), nothing is locked.
one_at_a_time() {
    command -v flock >/dev/null || return 0
    exec 9<tests/setup
    flock -n 9 && return 0
    say "another run is busy with $2 in this folder; waiting up to $1 s for it"
    flock -w "$1" 9 || fail "another run was still busy with $2 in $PWD after $1 s: let it end, or end it, then try again"
}

# quietly NAME COMMAND...: its output goes to a log; the log's end is shown when the command fails.
quietly() {
    local log=$LOGS/$1.log
    shift
    mkdir -p "$LOGS"
    "$@" >"$log" 2>&1 </dev/null 9<&- 8<&- && return 0 # a daemon that it starts must not keep the lock
    say "failed: $*"
    tail -n 20 "$log" >&2
    return 1
}

# apt_install PACKAGE...: install them if this user may; otherwise one line that names them, and status 1.
apt_install() {
    local -a root=(env DEBIAN_FRONTEND=noninteractive)
    if ! command -v apt-get >/dev/null; then
        say "please install with the system's package manager (Debian's names): $*"
        return 1
    elif [ "$(id -u)" != 0 ]; then
        if ! sudo -n true 2>/dev/null; then
            say "please install as root: apt-get install $*"
            return 1
        fi
        root=(sudo -n "${root[@]}")
    fi
    say "installing: $*"
    # An update that fails for one of several sources need not stop the install, which tells for itself.
    quietly apt-update "${root[@]}" apt-get -q -o DPkg::Lock::Timeout=120 update || true
    quietly apt-install "${root[@]}" apt-get -q -y -o DPkg::Lock::Timeout=120 install --no-install-recommends "$@" ||
        { say "please install as root: apt-get install $*" && return 1; }
}

# What a compiler can do is asked by using it: a package's name says less.
can_compile() { printf '#include <stdint.h>\n#include <stdio.h>\nint main(void) { return 0; }\n' | "$@" -x c - -o /dev/null 2>/dev/null; }
has_m32() { can_compile cc -m32; }
has_arm() { printf '#include <string.h>\nint main(void) { return 0; }\n' | arm-none-eabi-gcc --specs=nosys.specs -x c - -o /dev/null 2>/dev/null; }
has_gpiod() { printf '#include <gpiod.h>\nint main(void) { return 0; }\n' | cc -x c - -lgpiod -o /dev/null 2>/dev/null; }
has_fuzzer() {
    printf '#include <stdint.h>\n#include <stddef.h>\nint LLVMFuzzerTestOneInput(const uint8_t *d, size_t n) { (void)d; (void)n; return 0; }\n' |
        clang -fsanitize=fuzzer,address -x c - -o /dev/null 2>/dev/null
}
