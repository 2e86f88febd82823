#!/usr/bin/env bash
# Goal: what meson installs works from where it lies, and with its helpers elsewhere; and a program of
# somebody else's can be made of the library.
# Method: an installation into a folder of its own, moved away from where it was told to be; each helper
# asked for beside the program, in METANODE_HELPER_DIR, and where it is not. docs/example.c, compiled as
# C and as C++ with what pkg-config says, and every header by itself.
# e2e_install.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
cd "$scratch"
built=$(dirname "$metanode")

if ! DESTDIR=$scratch/dest meson install -C "$build" --no-rebuild >"$out" 2>"$err"; then
    fail "meson install: $(tail -n 2 "$out")"
    finish
fi
mv "$(dirname "$(find dest -name metanode -type f)")" there
metanode=$scratch/there/metanode
check "nothing but programs, headers and one archive is installed" \
    test "$(find dest -type f ! -path '*/include/metanode/*.h' | wc -l)" -eq 2
check "each header is installed" test "$(find dest -name '*.h' | wc -l)" -eq \
    "$(find "$root/include/metanode" -name '*.h' | wc -l)"

# uses COMPILER SUFFIX: as a stranger would.
uses() {
    local compile=("$1" -Wall -Wextra -Wpedantic -Werror) program=./example-$2 pc flags header code=0
    command -v "$1" >/dev/null || { skip "$1 is not there"; return 0; }
    pc=$(find "$scratch/dest" -name metanode.pc)
    read -ra flags < <(PKG_CONFIG_PATH=$(dirname "$pc") pkg-config --cflags --libs metanode \
        --define-variable=prefix="$scratch/dest$(sed -n 's/^prefix=//p' "$pc")")
    cp "$root/docs/example.c" "example.$2"
    check "$1" "${compile[@]}" "example.$2" "${flags[@]}" -o "$program" || return 0
    "$program" ball.mnt >"$out" 2>"$err" || code=$?
    check "$1: flies" test "$code $(grep -c '^frame .* triangles' "$out")" = "0 60" || true
    "$program" nothing.mnt >"$out" 2>"$err" || code=$?
    check "$1: what is wrong" test "$code $(grep -c '^nothing.mnt: ' "$err")" = "3 1" || true
    for header in "$root"/include/metanode/*.h; do
        echo "#include <metanode/$(basename "$header")>" >"alone.$2"
        check "$1: $(basename "$header") alone" "${compile[@]}" -fsyntax-only "alone.$2" "${flags[@]}" || true
    done
}

# subdivides WANT NAME, draws WANT NAME: the two that need help.
subdivides() {
    [[ -x $built/metanode-openmesh ]] || return 0
    expect "$1" "subdivide, $2" make subdivide ball.ply --times 1 -o fine.ply
}
draws() { expect "$1" "shoot, $2" shoot ball.mnt --size 64x48 -o ball.png; }

expect 0 make make sphere --triangles 3000 -o ball.ply || finish
expect 0 build build ball.ply -o ball.mnt
expect 0 replay replay ball.mnt --path orbit --frames 3 --fps 0 --ram 16M
if $sanitized; then
    skip "a library with sanitizers"
else
    uses gcc c
    uses g++ cc
fi
graphics=0
"$built/metanode" shoot ball.mnt --size 64x48 -o ball.png 2>/dev/null || graphics=$?
subdivides 0 "beside the program"
draws "$graphics" "beside the program"
ln -s there/metanode linked
metanode=$scratch/linked subdivides 0 "through a link"
mkdir helpers
mv there/metanode-* helpers/
subdivides 1 "no helper" && one_line "no helper" metanode-openmesh METANODE_HELPER_DIR
draws 6 "no module" && one_line "no module" metanode-gl.so METANODE_HELPER_DIR
export METANODE_HELPER_DIR=$scratch/helpers
subdivides 0 "helpers elsewhere"
draws "$graphics" "helpers elsewhere"
METANODE_HELPER_DIR=/nowhere subdivides 1 "helpers nowhere" && one_line "helpers nowhere" /nowhere/metanode-openmesh
finish
