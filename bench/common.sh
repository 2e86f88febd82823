# What the scripts of this folder share; sourced by them. METANODE names the program (the release
# build otherwise), MN_MESHES the folder of the real models.
# shellcheck shell=bash
top=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
metanode=${METANODE:-$top/build-release/tools/metanode}
meshes=${MN_MESHES:-$top/../shared/meshes}
scratch=$(mktemp -d "${TMPDIR:-/tmp}/metanode-bench-XXXXXX")
trap 'rm -rf "$scratch"' EXIT

if [[ -z ${METANODE-} ]]; then
    [[ -f $top/build-release/build.ninja ]] ||
        meson setup "$top/build-release" "$top" --buildtype=release >/dev/null
    ninja -C "$top/build-release" --quiet
fi

# The value of a key in the program's JSON: one key a line, plain numbers.
value() { # file key
    sed -nE "s/^ *\"$2\": \"?([^\",]*)\"?,?\$/\1/p" "$1" | head -1
}

bytes() { # 16M and the like
    case $1 in
    *K) echo $((${1%K} * 1024)) ;;
    *M) echo $((${1%M} * 1024 * 1024)) ;;
    *G) echo $((${1%G} * 1024 * 1024 * 1024)) ;;
    *) echo "$1" ;;
    esac
}

counted() { # number noun: 1 run, 2 runs
    [[ $1 -eq 1 ]] && echo "1 $2" || echo "$1 $2s"
}
