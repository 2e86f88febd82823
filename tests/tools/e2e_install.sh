#!/usr/bin/env bash
# Goal: what meson installs works from where it lies, and with its helpers elsewhere.
# Method: an installation into a folder of its own, moved away from where it was told to be; each helper
# asked for beside the program, in METANODE_HELPER_DIR, and where it is not.
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
check "nothing but the programs is installed" test -z "$(find dest -type f)"

# subdivides WANT NAME, draws WANT NAME: the two that need help.
subdivides() {
    [[ -x $built/metanode-openmesh ]] || return 0
    expect "$1" "subdivide, $2" make subdivide ball.ply --times 1 -o fine.ply
}
draws() { expect "$1" "shoot, $2" shoot ball.mnt --size 64x48 -o ball.png; }

expect 0 make make sphere --triangles 3000 -o ball.ply || finish
expect 0 build build ball.ply -o ball.mnt
expect 0 replay replay ball.mnt --path orbit --frames 3 --fps 0 --ram 16M
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
