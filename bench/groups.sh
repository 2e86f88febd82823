# Memory cgroups of both versions, for the scripts of this folder; sourced by them. Sets kind (v1, v2,
# none: none can be made here, and why). group_make BYTES, run_in_group USER COMMAND…, group_peak,
# group_kills, group_cache, group_remove: one group at a time.
# shellcheck shell=bash
# The kernel's two kinds of cgroups: where a group is made, and what its files are called.
kind=none why='not root, or no memory controller that can be written'
parent=
cgroups=${CGROUPS:-/sys/fs/cgroup}
for mount in "$cgroups/memory" "$cgroups"; do
    try=$mount/metanode-$$
    if [[ -f $mount/memory.limit_in_bytes ]]; then
        kind_here=v1
    else
        kind_here=v2
        echo +memory 2>/dev/null >"$mount/cgroup.subtree_control" || true
    fi
    mkdir "$try" 2>/dev/null || continue
    if [[ -f $try/memory.limit_in_bytes || -f $try/memory.max ]]; then
        kind=$kind_here parent=$mount
    fi
    rmdir "$try"
    [[ $kind == none ]] || break
done

group_make() { # bytes
    group=$parent/metanode-$$
    mkdir "$group"
    if [[ $kind == v1 ]]; then
        echo "$1" >"$group/memory.limit_in_bytes"
        echo "$1" 2>/dev/null >"$group/memory.memsw.limit_in_bytes" || true
    else
        echo "$1" >"$group/memory.max"
        echo 0 2>/dev/null >"$group/memory.swap.max" || true
    fi
}

group_peak() {
    if [[ $kind == v1 ]]; then
        cat "$group/memory.max_usage_in_bytes"
    else
        cat "$group/memory.peak" 2>/dev/null || echo unknown
    fi
}

group_kills() {
    if [[ $kind == v1 ]]; then
        sed -n 's/^oom_kill //p' "$group/memory.oom_control"
    else
        sed -n 's/^oom_kill //p' "$group/memory.events"
    fi
}

group_cache() { # bytes of files that it holds
    sed -nE 's/^(cache|file) //p' "$group/memory.stat" | head -1
}

run_in_group() { # user command…: joins the group, then becomes the user
    local user=$1
    shift
    local become=()
    [[ $user == root || $(id -u) -ne 0 ]] ||
        become=(setpriv --reuid=65534 --regid=65534 --clear-groups)
    if [[ $kind == none ]]; then
        "${become[@]}" "$@"
    else
        # shellcheck disable=SC2016
        bash -c 'echo $$ >"$0/cgroup.procs"; exec "$@"' "$group" "${become[@]}" "$@"
    fi
}

group_remove() {
    rmdir "$group"
}
