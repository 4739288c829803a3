#!/usr/bin/env bash
# wheel.sh FOLDER   builds the wheel of this tree into FOLDER, with the tools of .venv: nothing is downloaded.
set -euo pipefail
cd "$(dirname "$0")/../.."
. tests/setup/system.sh
export PATH="$PWD/.venv/bin:$PATH"
quietly wheel python -m pip wheel . --no-deps --no-build-isolation --wheel-dir "${1:?a folder}"
ls "$1"/terrapin_robot-*.whl
