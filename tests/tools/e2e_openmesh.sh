#!/usr/bin/env bash
# Goal: what OpenMesh does for the program: a second opinion on good files, subdivision, the yardstick.
# Method: its reader beside ours on every format; counts that Loop's scheme gives; the benches on small
# models, their keys and what must hold of any such figures.
# e2e_openmesh.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
source "$(dirname "$0")/e2e_shapes.sh"
cd "$scratch"

# Both readers see the same mesh; a file without faces or with half of them is neither's.
second_opinion() {
    local file=$1 counts
    expect 0 "$file, our reader" build "$file" -o ours.mnt --json || return 0
    counts=$(figures vertices triangles components boundary_edges | paste -sd' ')
    expect 0 "$file, OpenMesh" build "$file" -o theirs.mnt --reader openmesh --json || return 0
    check "$file: the same counts" test "$counts" = \
        "$(figures vertices triangles components boundary_edges | paste -sd' ')"
    expect 0 "$file: OpenMesh's is ours" verify theirs.mnt --against "$file" || true
}

subdivided() {
    local triangles
    expect 0 sphere build sphere.ply -o sphere.mnt --json || return 0
    triangles=$(figures triangles)
    expect 0 subdivide make subdivide sphere.ply --times 2 -o fine.ply || return 0
    expect 0 fine build fine.ply -o fine.mnt --json || return 0
    holds "four triangles for one, twice" "$(figures triangles) == 16 * $triangles"
    equal "still closed" boundary_edges 0
    equal "still in one piece" components 1
    shape fins >fins.obj
    expect 3 "fins" make subdivide fins.obj --times 1 -o x.ply && one_line "fins" fins.obj manifold
    check "nothing is left behind" test ! -e x.ply
}

benches() {
    expect 0 "bench simplify" bench simplify sphere.ply --globe 40 --runs 1 --samples 20000 --json || return 0
    check "bench simplify: keys" "$helpers/e2e_json" metric runs samples inputs <"$out"
    check "bench simplify: two inputs, three levels each" \
        test "$(grep -c '"openmesh_distance"' "$out")" -eq 6
    check "bench simplify: no figure is missing" test "$(grep -c null "$out")" -eq 0
    expect 0 "bench simplify as a table" bench simplify sphere.ply --runs 0 --samples 5000 || true
    printf 'OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n' >one.off
    expect 0 "bench simplify of a triangle" bench simplify one.off --runs 1 --samples 100 || true
    check "bench simplify of a triangle: no ratio" test "$(grep -c 'ratio none' "$out")" -eq 4 # had inf and nan
    expect 2 "a globe too small" bench simplify --globe 3 && one_line "a globe too small" "'3'" # it had said (null)
    expect 2 "bench simplify of nothing" bench simplify && one_line "bench simplify of nothing" --globe
    expect 2 "no such bench" bench nothing && one_line "no such bench" nothing
}

if [[ ! -x $build/tools/metanode-openmesh ]]; then
    skip "metanode-openmesh was not built"
    finish
fi
expect 0 sphere make sphere --triangles 6000 -o sphere.ply || finish
shape torus >torus.obj
part second_opinion sphere.ply
part second_opinion torus.obj
part subdivided
part benches
finish
