#!/usr/bin/env bash
# build.sh PRESET...   configures and builds CMake presets; silent when there is nothing to do, the log's end when it fails.
# build.sh robot=NAME|FILE PRESET...   the same for a robot that is not the cylinder: under build/robots/NAME.
# build.sh size        prints the size of the core on Cortex-M4.
set -euo pipefail
cd "$(dirname "$0")/../.."
. tests/setup/system.sh
export PATH="$PWD/.venv/bin:$PATH"
one_at_a_time "${TERRAPIN_WAIT:-900}" "a build"
robot=cylinder
for preset in "$@"; do
    if [ "${preset#robot=}" != "$preset" ]; then
        robot=${preset#robot=}
        continue
    fi
    if [ "$robot" != cylinder ]; then
        [ -f "$robot" ] && robot=$(realpath "$robot")
        name=$(basename "$robot" .toml)
        place=build/robots/$name/$preset
        if [ "$preset" = size ]; then
            ctest --test-dir "build/robots/$name/cortex-m4" -V | sed -n 's/^[0-9]*: //p' | grep -Ev '^(Test|Working)'
            continue
        fi
        mkdir -p "build/robots/$name"
        if command -v flock >/dev/null; then # commands that select this robot build it, too (hil/terrapin_hil/robots.py)
            exec 8>"build/robots/$name/lock"
            flock -w "${TERRAPIN_WAIT:-900}" 8 || fail "another program was still building $name: let it end, then try again"
        fi
        targets=(all) options=()
        [ "$preset" = host ] && targets=(terrapin terrapin-controller terrapin_boot interface) options=(-DTERRAPIN_HIL=OFF)
        [ -f "$place/build.ninja" ] || say "building $preset for $name"
        quietly "configure-$name-$preset" cmake --preset "$preset" -B "$place" "-DPython3_EXECUTABLE=$PWD/.venv/bin/python" \
            "-DTERRAPIN_ROBOT=$robot" ${UNITY_ROOT:+"-DUNITY_ROOT=$UNITY_ROOT"} "${options[@]}"
        quietly "build-$name-$preset" cmake --build "$place" --target "${targets[@]}"
        continue
    fi
    if [ "$preset" = size ]; then
        ctest --preset cortex-m4 -V | sed -n 's/^[0-9]*: //p' | grep -Ev '^(Test|Working)'
        continue
    fi
    [ -f "build/$preset/build.ninja" ] || say "building $preset"
    # Programs that are found once stay in CMake's cache, so the interpreter is named.
    quietly "configure-$preset" cmake --preset "$preset" "-DPython3_EXECUTABLE=$PWD/.venv/bin/python" ${UNITY_ROOT:+"-DUNITY_ROOT=$UNITY_ROOT"}
    quietly "build-$preset" cmake --build --preset "$preset"
done
