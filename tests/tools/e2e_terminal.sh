#!/usr/bin/env bash
# Goal: long work says on a terminal how far it is, how fast, how long yet, and in how much memory, for each
# of its phases, and leaves the line clean; in a pipe it says nothing.
# Method: the same commands with a terminal of script(1) for standard error, and without.
# e2e_terminal.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
cd "$scratch"

if ! script -qec true /dev/null >/dev/null 2>&1 </dev/null; then
    skip "no terminal can be had of script(1)"
    finish
fi

# phases NAME PHASE… -- ARGUMENT…: each phase shows, in that order. All four figures stand there from the
# second time on that a phase shows: every 0.2 s.
phases() {
    local name=$1 wanted=() shown
    shift
    while [[ $1 != -- ]]; do
        wanted+=("$1")
        shift
    done
    shift
    expect 0 "$name, in a pipe" "$@"
    check "$name: silence in a pipe" test ! -s "$err"
    script -qec "$metanode $* >$scratch/figures" /dev/null >"$out" 2>"$err" </dev/null || fail "$name: exit $?"
    tr '\r' '\n' <"$out" | grep -E '^[a-z]+ +[0-9]+ %' >lines || true
    shown=$(awk '{print $1}' lines | uniq | paste -sd' ')
    check "$name: phases $shown" test "$shown" = "${wanted[*]}"
    check "$name: never more than all" test "$(awk '$2 > 100' lines | wc -l)" -eq 0
    check "$name: rate, time left, memory" awk '$1 == last && !/%  [0-9]+\/s  [0-9]+ s left  [0-9.]+ MB/ {exit 1} {last = $1}' lines
    check "$name: the line is cleaned" test "$(tail -c 4 "$out" | od -An -c | tr -d ' ')" = '\r033[K'
}

expect 0 model make sphere --triangles 250000 -o ball.ply || finish
part phases make making -- make isosurface --triangles 3000000 -o rock.ply
# what is moved to the grid is written beside the checks, where there is a second thread
part phases build read number check deal simplify order blocking -- build ball.ply -o ball.mnt -j 2
check "a build shows more than once" test "$(wc -l <lines)" -gt 4
part phases simplify read number check grid deal simplify order writing -- simplify ball.ply -o ball.vdt -j 1
part phases block checking blocking -- block ball.vdt -o other.mnt
part phases block checking loading blocking -- block ball.mnt -o other.mnt
part phases verify checking -- verify ball.mnt
part phases verify read number check grid comparing checking comparing checking comparing -- verify ball.mnt --against ball.ply
part phases extract checking -- extract ball.mnt --triangles 9000 -o coarse.ply
part phases extract checking extracting -- extract ball.mnt --full -o whole.ply
part phases extract checking settling extracting -- extract ball.mnt --error 0.0001 -o near.ply
part phases compare read measuring -- compare ball.ply coarse.ply --samples 300000
part phases "bench error" read simplify measuring -- bench error ball.ply --fronts 1 --samples 100000
part phases replay frames -- replay ball.mnt --path orbit --frames 30
if [[ -x $build/tools/metanode-openmesh ]]; then
    script -qec "$metanode bench simplify --globe 100 --runs 1 --samples 20000" /dev/null >"$out" 2>"$err" </dev/null
    shown=$(tr '\r' '\n' <"$out" | sed -nE 's/^(.*[^ ]) +[0-9]+ %.* MB.*/\1/p' | uniq | paste -sd,)
    levels=$(printf ',OpenMesh at %s %%,ours at %s %%' 50 50 10 10 1 1)
    check "bench simplify: phases $shown" test "$shown" = "simplify,openmesh,simplify$levels"
    expect 0 "bench simplify, in a pipe" bench simplify --globe 20 --runs 1 --samples 200
    check "bench simplify: silence in a pipe" test ! -s "$err"
else
    skip "bench simplify: no OpenMesh"
fi
script -qec "$metanode build missing.ply -o x.mnt" /dev/null >"$out" 2>"$err" </dev/null || true
check "an error has a line of its own" grep -qE '^metanode: missing.ply' "$out"
finish
