#!/usr/bin/env bash
# docs.sh   the pages of docs/ and the generated reference of the interface as a site: build/docs/index.html. A link that
#           leads nowhere is an error.
set -euo pipefail
cd "$(dirname "$0")/../.."
rm -rf build/docs-source build/docs
mkdir -p build/docs-source
cp -r docs/. build/docs-source/
cp build/host/generated/interface.md build/docs-source/
.venv/bin/sphinx-build -q -W --keep-going -b html -d build/docs-source/.trees build/docs-source build/docs
echo "build/docs/index.html"
