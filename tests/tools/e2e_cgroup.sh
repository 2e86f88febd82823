#!/usr/bin/env bash
# Goal: the plan holds: in a memory cgroup of exactly --ram a navigation whose front is full ends well. And
# bench/cgroup reads and writes the files of cgroups of version 2 as the kernel means them, also where the
# kernel has version 1.
# Method: replay in the kernel's own cgroup, whichever it has, skipped where none can be made. For version 2
# a folder that behaves like one: mkdir in it makes the files of a group, rmdir notes what was written into
# them and takes them away.
# e2e_cgroup.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
if $sanitized; then
    skip "cgroups of a cap: a sanitizer takes memory of its own"
    finish
fi
cd "$scratch"
chmod 755 "$scratch"

# A group's files, but for what LACKS names; KILLS is in its memory.events.
mkdir -p bin groups
cat >bin/mkdir <<'END'
#!/bin/bash
/bin/mkdir "$@" || exit
group=${!#}
[[ $group == "$GROUPS_HERE"/* ]] || exit 0
echo max | tee "$group/memory.max" >"$group/memory.swap.max"
echo 12345678 >"$group/memory.peak"
printf 'low 0\nhigh 0\nmax 7\noom 3\noom_kill %s\noom_group_kill 9\n' "${KILLS:-0}" >"$group/memory.events"
: >"$group/cgroup.procs"
[[ -z ${LACKS-} ]] || rm "$group/$LACKS"
END
cat >bin/rmdir <<'END'
#!/bin/bash
group=${!#}
if [[ $group == "$GROUPS_HERE"/* ]]; then
    echo "$(cat "$group/memory.max" "$group/memory.swap.max" "$group/cgroup.procs" 2>/dev/null | paste -sd' ')" >>"$GROUPS_HERE.log"
    rm -f "$group"/*
fi
exec /bin/rmdir "$@"
END
chmod +x bin/mkdir bin/rmdir
export GROUPS_HERE=$scratch/groups

# measured CODE NAME: bench/cgroup in the folder, its output in $out.
measured() {
    local code=0
    rm -f groups.log groups/*
    : >groups/cgroup.subtree_control
    PATH=$scratch/bin:$PATH CGROUPS=$GROUPS_HERE METANODE=$metanode FRAMES=4 \
        "$root/bench/cgroup" ball.mnt >"$out" 2>"$err" || code=$?
    check "$2: exit $code instead of $1" test "$code" -eq "$1"
}

expect 0 ball make sphere --triangles 3000 -o ball.ply
expect 0 ball build ball.ply -o ball.mnt
chmod 644 ball.mnt

measured 0 "version 2"
check "which version" grep -q 'memory cgroup v2' "$out"
check "the sum" grep -q '^all caps held' "$out"
check "the controller is asked for" grep -qx '+memory' groups/cgroup.subtree_control
for limit in 16777216 25165824 50331648; do
    check "a group of $limit bytes, without swap, with one process" \
        grep -qxE "$limit 0 [0-9]+" groups.log
done
holds "a group for each run, after the trial" \
    "$(grep -cxE '[0-9]+ 0 [0-9]+' groups.log) == $(grep -c ' ok$' "$out")"
holds "the peak is memory.peak" "$(grep -c ' 12345678 ' "$out") == $(grep -c ' ok$' "$out")"

KILLS=2 measured 1 "a kill"
holds "a kill is a failure, whatever the exit" \
    "$(awk '/ FAILED$/ {f++} / ok$/ {o++} END {print f + 0 " >= 10 && 0 == " o + 0}' "$out")"

LACKS=memory.peak measured 0 "a kernel before memory.peak"
check "no peak" grep -q ' unknown ' "$out"

LACKS=memory.max measured 0 "no memory controller"
check "it is said" grep -q 'no memory cgroup can be made' "$out"
check "the sum without groups" grep -q '^all caps held' "$out"

# ---- the kernel's own -----------------------------------------------------------------------------

# shellcheck source=../../bench/groups.sh
source "$root/bench/groups.sh"

# planned NAME BYTES ARGUMENT…: a dive that wants more than there is room for, in a cgroup of so many bytes.
planned() {
    local name=$1 cap=$2 code=0 peak kills
    shift 2
    group_make "$cap"
    run_in_group root "$metanode" replay ground.mnt --path dive --tolerance 0.2 --degrade off \
        --open settled --frames 120 --fps 240 --ram "$cap" --json "$@" >"$out" 2>"$err" || code=$?
    peak=$(group_peak) kills=$(group_kills)
    group_remove
    holds "$name: exit $code, ${kills:-0} kills" "$code == 0 && ${kills:-0} == 0"
    [[ $code -eq 0 ]] || return 1
    holds "$name: $cap bytes planned" "$(figures ram_planned_bytes) <= $cap"
    holds "$name: the parts of the plan" "$(figures ram_base_bytes ram_front_bytes ram_pool_bytes \
        ram_tables_bytes | paste -sd+) == $(figures ram_planned_bytes)"
    [[ $peak == unknown ]] || holds "$name: $peak bytes at the peak" "$peak <= $cap"
}

# full NAME BYTES ARGUMENT…: one in which the front has no room left.
full() {
    planned "$@" || return 1
    holds "$1: the front was full" \
        "$(figures refused_front) > 0 && $(figures active_nodes_max) >= 0.9 * $(figures front_max)"
}

# least_ram ARGUMENT…: what the plan with these takes, as the program says.
least_ram() {
    "$metanode" replay ground.mnt --path dive --frames 1 --json "$@" >"$out" 2>"$err"
    figures ram_min_bytes
}

in_the_kernels() {
    if [[ $kind == none ]]; then
        skip "the kernel's own cgroups: $why"
        return
    fi
    expect 0 ground make terrain --triangles 200000 -o ground.ply
    expect 0 ground build ground.ply -o ground.mnt --block-bytes 4096
    full "5 MB" 5242880
    full "8 MB" 8388608
    full "8 MB, traced" 8388608 --trace ground.trace
    full "80 places, 1,600 nodes" "$(least_ram -K 80 --front-max 1600)" -K 80 --front-max 1600
    full "the same, mapped" "$(least_ram -K 80 --front-max 1600)" -K 80 --front-max 1600 --store mapped
    planned "40 places, 9,000 nodes" "$(least_ram -K 40 --front-max 9000)" -K 40 --front-max 9000
    planned "the least" "$(least_ram -K min)" -K min
}
part in_the_kernels
finish
