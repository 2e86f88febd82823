#!/usr/bin/env bash
# Goal: bench/cgroup reads and writes the files of cgroups of version 2 as the kernel means them, also
# where the kernel has version 1.
# Method: a folder that behaves like one: mkdir in it makes the files of a group, rmdir notes what was
# written into them and takes them away. The kernel's own, whichever it has, is what tools/check runs.
# e2e_cgroup.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
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
finish
