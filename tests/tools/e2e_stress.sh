#!/usr/bin/env bash
# Goal: stress holds on sound files of both policies, replays by its seed, and says plainly what it
# cannot do. Method: short stresses of a made model through the program.
source "$(dirname "$0")/e2e_lib.sh"

expect 0 make make sphere --triangles 6000 -o "$scratch/s.ply"
expect 0 packed build "$scratch/s.ply" --block-bytes 4K -o "$scratch/packed.mnt"
expect 0 levels build "$scratch/s.ply" --blocking levels -L 3 -o "$scratch/levels.mnt"

for policy in packed levels; do
    file=$scratch/$policy.mnt
    expect 0 "$policy, by lot" stress "$file" --runs 12 --frames 60 --json
    check "$policy: json" grep -q '"held": true' "$out"
    check "$policy: so many runs" grep -q '"runs": 12,' "$out"
    expect 0 "$policy, least memory" stress "$file" --runs 6 --frames 60 -K min
    check "$policy: words" grep -q 'every invariant after every frame' "$out"
    # On the simulated disk a seed says everything.
    for run in 1 2; do
        expect 0 "$policy, seed" stress "$file" --runs 1 --seed 77 --io sim --json
        grep -v seconds "$out" >"$scratch/$run.json"
    done
    check "$policy: the same again" cmp "$scratch/1.json" "$scratch/2.json"
done

# Where io_uring is refused: by lot, of 40 runs some.
expect 0 "refused rings" stress "$scratch/packed.mnt" --runs 40 --frames 20 --json
check "refused rings: some" test "$(sed -nE 's/.*"runs_uring_refused": ([0-9]+),/\1/p' "$out")" -gt 0

has_gone() { [[ ! -e /proc/$1 ]] || grep -q '^State:.*Z' "/proc/$1/status" 2>/dev/null; }

# An interrupt, which the run's own process gets as well, or does not, is no finding. It ends the run
# too, which would go on for hours (at first the end of the run was waited for).
for to in "-" ""; do
    set -m # or it would be deaf to SIGINT
    "$metanode" stress "$scratch/packed.mnt" --runs 2 --frames 1000000 --io sim >"$out" 2>"$err" &
    set +m
    child=$! code=0
    run=
    for _ in $(seq 600); do
        run=$(pgrep -P "$child") && break
        sleep 0.1
    done
    kill -INT -- "$to$child"
    wait "$child" 2>/dev/null || code=$?
    check "interrupt: exit $code, $(head -n 1 "$err")" test "$code" -eq 0
    check "interrupt: nothing is claimed" grep -q 'interrupted before the first run was over' "$out"
    check "interrupt: the run has gone" has_gone "$run"
done

# The end of --seconds too, and though there is a run that would go on for hours (it was waited for).
expect 0 "end" stress "$scratch/packed.mnt" --seconds 1 --frames 1000000 --io sim
check "end: nothing is claimed" grep -q 'the first run was not over in 1 second' "$out"
expect 0 "end, figures" stress "$scratch/packed.mnt" --seconds 1 --frames 1000000 --io sim --json
check "end: no run" grep -q '"runs": 0,' "$out"
check "end: it says so" grep -q '"last_run_cut": true' "$out"

# Who hears it goes, and with him who is heard.
"$metanode" stress "$scratch/packed.mnt" --runs 2 --frames 1000000 --io sim >"$out" 2>"$err" &
child=$!
run=
for _ in $(seq 600); do
    run=$(pgrep -P "$child") && break
    sleep 0.1
done
sleep 0.5 # it has to have said that it wants to go as well
kill -KILL "$child"
wait "$child" 2>/dev/null || true
for _ in $(seq 600); do
    has_gone "$run" && break
    sleep 0.1
done
check "killed: the run has gone" has_gone "$run"

# What ends a run is a finding, and the line that repeats it may be pasted as it is: of a path with
# a space and a quote it had two words and an open quote.
mkdir "$scratch/it's a folder"
odd="$scratch/it's a folder/s.mnt"
cp "$scratch/packed.mnt" "$odd"
"$metanode" stress "$odd" --runs 1 --frames 100000 >"$out" 2>"$err" &
child=$! code=0
run=
for _ in $(seq 100); do
    run=$(pgrep -P "$child") && break
    sleep 0.1
done
kill -KILL "$run"
wait "$child" || code=$?
check "a run that is killed: exit $code" test "$code" -eq 1
check "a run that is killed: it says so" grep -q 'seed 1: it was ended by signal 9' "$err"
again=$(sed -n 's/^  again: metanode //p' "$err" | sed 's/--frames [0-9]*/--frames 20/')
eval "expect 0 'the line again' $again"

head -c 20000 "$scratch/packed.mnt" >"$scratch/cut.mnt"
expect 3 "cut file" stress "$scratch/cut.mnt" --runs 1
expect 3 "no such file" stress "$scratch/none.mnt" || true
expect 2 "too few place holders" stress "$scratch/packed.mnt" -K 1 --runs 1
expect 2 "no file" stress
expect 2 "no number" stress "$scratch/packed.mnt" -K some

finish
