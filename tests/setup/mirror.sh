# Sourced after system.sh: packages from the mirrors that this machine's apt is set up with. apt itself verifies signatures
# and checksums; its lists and packages stay in a temporary folder, so no root is needed. In it: out/, tree/, log.
work=$(mktemp -d "${TMPDIR:-/tmp}/mirror.XXXXXX")
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/lists/partial" "$work/archives/partial" "$work/out"

# with_source LINE APT_ARGUMENT...: apt-get with this one source instead of the machine's.
with_source() {
    printf '%s\n' "$1" >"$work/sources.list"
    shift
    (cd "$work/out" && apt-get -q -o Dir::Etc::SourceList="$work/sources.list" -o Dir::Etc::SourceParts=/dev/null \
        -o Dir::State::Lists="$work/lists" -o Dir::Cache="$work" -o APT::Sandbox::User="$(id -un)" -o Acquire::Languages=none \
        -o Acquire::Retries=2 -o Acquire::IndexTargets::deb::DEP-11::DefaultEnabled=false "$@") >>"$work/log" 2>&1 </dev/null
}

# each_source FUNCTION: calls it with "KEYRING MIRROR SUITE COMPONENT" and "KEYRING MIRROR" of each source until it succeeds; the
# security and update suites repeat the others.
each_source() {
    local keyring='' file source mirror suite component
    local -a sources
    for file in /usr/share/keyrings/{debian,ubuntu}-archive-keyring.gpg; do
        [ ! -f "$file" ] || keyring="[signed-by=$file] "
    done
    mapfile -t sources < <(apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' |
        grep -Ev 'security|updates|backports' | sort -u)
    for source in "${sources[@]}"; do
        read -r mirror suite component <<<"$source"
        case $component in main | universe) ;; *) continue ;; esac
        "$1" "$keyring$mirror $suite $component" "$keyring$mirror" && return
    done
    return 1
}
