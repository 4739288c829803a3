#!/usr/bin/env bash
# release.sh [FOLDER [ROBOT]]   packs terrapin::core with its generated C into FOLDER (build/release), prints the archive's path.
# ROBOT is a shipped robot or the file of one (cylinder): the scales, ranges and defaults in the C are that robot's.
# The same tree gives the same bytes: sorted names, one owner, one time (SOURCE_DATE_EPOCH, else 1980).
set -euo pipefail
cd "$(dirname "$0")/../.."
out=${1:-build/release}
robot=${2:-cylinder}
version=$(sed -n 's/^project(terrapin VERSION \([0-9.]*\) .*/\1/p' CMakeLists.txt)
of=$(basename "$robot" .toml)
[ "$of" = cylinder ] && name=terrapin-core-$version || name=terrapin-core-$of-$version
work=$(mktemp -d "${TMPDIR:-/tmp}/terrapin-release.XXXXXX")
trap 'rm -rf "$work"' EXIT
tree=$work/$name
python=.venv/bin/python
[ -x "$python" ] || python=python3

mkdir -p "$tree/firmware/core" "$tree/firmware/cmake" "$out"
"$python" -B firmware/terrapin_interface/generate.py --out "$tree/generated" --robot "$robot"
cp firmware/core/*.[ch] "$tree/firmware/core/"
cp firmware/cmake/{core_package,short_core}.cmake firmware/cmake/terrapin-core.pc.in "$tree/firmware/cmake/"
cp CMakeLists.txt LICENSE firmware/cmake/library.json "$tree/" # library.json: PlatformIO looks for it here
cp -r zephyr "$tree/"
cp docs/embedding.md "$tree/README.md"
(cd firmware/terrapin_interface && sha256sum controller.toml) >"$tree/controller.toml.sha256"
find "$tree" -type d -exec chmod 755 {} + -o -type f -exec chmod 644 {} +
tar -C "$work" --sort=name --format=ustar --mtime="@${SOURCE_DATE_EPOCH:-315532800}" --owner=0 --group=0 --numeric-owner \
    -cf - "$name" | gzip -9n >"$out/$name.tar.gz"
printf '%s\n' "$out/$name.tar.gz"
