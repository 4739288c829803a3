#!/usr/bin/env bash
# lock.sh   writes requirements.lock and requirements-dev.lock from pyproject.toml: exact versions, all hashes, no index address.
# Run with the oldest Python served, so that every version locked still supports it; UPGRADE=1 takes newer versions.
set -euo pipefail
cd "$(dirname "$0")/../.."
export CUSTOM_COMPILE_COMMAND="make lock"
options=(--quiet --generate-hashes --strip-extras --allow-unsafe --annotation-style=line
    --no-emit-index-url --no-emit-find-links --no-emit-trusted-host --no-emit-options ${UPGRADE:+--upgrade})
.venv/bin/python -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { echo "lock: needs Python 3.11, the oldest served" >&2; exit 2; }
.venv/bin/pip-compile "${options[@]}" --extra build --extra pictures -o requirements.lock pyproject.toml
.venv/bin/pip-compile "${options[@]}" --extra build --extra pictures --extra mf4 --extra cluster --extra rig --extra swd --extra docs --extra files --extra dev -c requirements.lock -o requirements-dev.lock pyproject.toml
