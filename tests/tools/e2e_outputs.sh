#!/usr/bin/env bash
# Goal: whatever stands in the way of an output, there is the right exit code and one line that names it,
# what stood there before stands yet, and nothing is left behind.
# Method: every command that writes × every obstacle: no such folder, a folder, a device, a disk that may
# not be written, one that is full, a limit on files, the input itself, an interrupt.
# e2e_outputs.sh [BUILD]
if [[ -z ${OUTPUTS_INSIDE-} ]] && unshare -rm true 2>/dev/null; then # a user may mount disks there
    OUTPUTS_INSIDE=1 exec unshare -rm "$0" "$@"
fi
source "$(dirname "$0")/e2e_lib.sh"
cd "$scratch"

# Each with its output at the end. These replace what stands there, whole:
whole=("build ball.ply -o" "simplify ball.ply -o" "block ball.vdt -o" "block ball.mnt --block-bytes 4K -o"
    "extract ball.mnt --full -o" "extract ball.vdt --triangles 20000 -o"
    "make sphere --triangles 40000 -o" "make isosurface --triangles 40000 -o")
# and these are written as the navigation goes on; the first stands under its name when it is whole.
logs=("replay ball.mnt --path orbit --fps 0 --frames 2000 --csv"
    "replay small.mnt --path flyover --io sim -K 80 --tolerance 3 --degrade off --frames 600 --trace")

# still NAME FILE: what stood there before a failed write stands there yet, and nothing beside it.
still() {
    check "$1: the old file stands" grep -q '^the old file$' "$2"
    check "$1: nothing is left behind" test "$(ls -A "$(dirname "$2")")" = "$(basename "$2")"
}

no_place() {
    local command target
    mkdir folder
    for command in "${whole[@]}" "${logs[@]}"; do
        for target in folder nowhere/x; do
            # shellcheck disable=SC2086
            expect 1 "$target: $command" $command "$target" && one_line "$target: $command" "$target"
        done
    done
    for command in "${whole[@]}"; do
        # shellcheck disable=SC2086
        expect 1 "a device: $command" $command /dev/full && one_line "a device: $command" /dev/full
    done
    check "a device stays a device" test -c /dev/full
    mkfifo fifo
    for target in folder nowhere/x fifo; do # a picture had taken the place of /dev/full
        expect 1 "$target: shoot" shoot ball.mnt --size 64x48 -o "$target" && one_line "$target: shoot" "$target"
    done
    check "a fifo stays a fifo" test -p fifo
    check "the folder stays empty" test -z "$(ls -A folder)"
    expect 1 "pictures in no folder" replay ball.mnt --path orbit --frames 1 --images nowhere/x &&
        one_line "pictures in no folder" nowhere/x
}

# disk NAME: an empty folder `disk` with that kind of disk in it, and an old file on it.
disk() {
    mkdir -p disk
    umount disk 2>/dev/null || true
    if ! mount -t tmpfs -o size=64k none disk 2>"$err"; then
        skip "$1: no disk can be mounted ($(head -n 1 "$err"))"
        return 1
    fi
    echo 'the old file' >disk/out
}

shut_disk() {
    local command
    disk "a disk that may not be written" || return 0
    mount -o remount,ro disk
    for command in "${whole[@]}" "${logs[@]}"; do
        # shellcheck disable=SC2086
        expect 1 "read-only: $command" $command disk/out && one_line "read-only: $command" disk/out
        still "read-only: $command" disk/out
    done
    expect 1 "read-only: pictures" replay ball.mnt --path orbit --frames 1 --images disk/x &&
        one_line "read-only: pictures" disk/x
    umount disk
}

full_disk() {
    local command
    for command in "${whole[@]}"; do
        disk "a full disk" || return 0
        # shellcheck disable=SC2086
        expect 4 "a full disk: $command" $command disk/out && one_line "a full disk: $command" disk/out space
        still "a full disk: $command" disk/out
    done
    for command in "${logs[@]}"; do
        disk "a full disk" || return 0
        head -c 126000 /dev/zero >disk/full
        # shellcheck disable=SC2086
        expect 4 "a full disk: $command" $command disk/log && one_line "a full disk: $command" disk/log space
        [[ $command == *trace ]] || check "a full disk: $command: no half of it" test ! -e disk/log
        [[ $command == *trace ]] || check "a full disk: $command: no figures of half a run" test "$(grep -c misses "$out")" -eq 0
    done
    disk "a full disk" || return 0
    head -c 122000 /dev/zero >disk/full
    for command in "replay ball.mnt --path orbit --frames 2000 --write-path" "trace t.trace --to csv -o"; do
        # shellcheck disable=SC2086
        expect 4 "a full disk: $command" $command disk/log && one_line "a full disk: $command" disk/log space
        check "a full disk: $command: no half of it" test ! -e disk/log
    done
    for command in "trace t.trace --to chrome -o" "trace t.trace --to report -o" "extract ball.mnt --error 0.0001 -o"; do
        disk "a full disk" || return 0
        head -c 100000 /dev/zero 2>/dev/null >disk/full || true # there are 64k
        # shellcheck disable=SC2086
        expect 4 "a full disk: $command" $command disk/out && one_line "a full disk: $command" disk/out space
        rm disk/full
        still "a full disk: $command" disk/out
    done
    expect 4 "a full disk for sorting" verify ball.mnt --against ball.ply --temp-dir disk &&
        one_line "a full disk for sorting" disk "space"
    still "a full disk for sorting" disk/out
    umount disk
    for command in "${logs[@]}"; do
        # shellcheck disable=SC2086
        expect 4 "a full device: $command" $command /dev/full && one_line "a full device: $command" /dev/full
    done
}

# ulimit -f kills by a signal who does not mind it.
limited_files() {
    local command real=$metanode
    cat >limited <<END
#!/bin/bash
ulimit -f 1
exec "$real" "\$@"
END
    chmod +x limited
    mkdir small
    metanode=$scratch/limited
    for command in "${whole[@]}"; do
        echo 'the old file' >small/out
        # shellcheck disable=SC2086
        expect 4 "ulimit -f: $command" $command small/out && one_line "ulimit -f: $command" small ulimit
        still "ulimit -f: $command" small/out
    done
    for command in "${logs[@]}"; do
        # shellcheck disable=SC2086
        expect 4 "ulimit -f: $command" $command log && one_line "ulimit -f: $command" log
    done
    metanode=$real
}

# over COMMAND… FILE: the last word names what the command reads.
over() {
    local file=${!#}
    cp -L "$file" before
    expect 2 "over its input: $*" "$@" && one_line "over its input: $*" "$file" another
    check "over its input: $*: it is as before" cmp "$file" before
}

over_the_input() {
    ln -s ball.ply link.ply
    ln ball.mnt hard.mnt
    printf 'metanode path 1\n0 0 9 0 0 0 0 1 0\n' >cameras.path
    over build ball.ply -o ball.ply
    over build ball.ply -o ./ball.ply
    over build ball.ply -o link.ply
    over simplify link.ply -o ball.ply
    over block ball.vdt -o ball.vdt
    over block ball.mnt -o ball.mnt
    over extract ball.mnt --full -o hard.mnt
    over make subdivide ball.ply --times 1 -o ball.ply
    over replay ball.mnt --path orbit --csv ball.mnt
    over replay ball.mnt --path orbit --trace hard.mnt
    over replay ball.mnt --path cameras.path --csv cameras.path
    over shoot ball.mnt -o ball.mnt
    over shoot ball.mnt --path cameras.path -o cameras.path
}

# interrupted NAME SIGNAL COMMAND…: stopped by the signal while it works; the old file stands.
interrupted() {
    local name=$1 signal=$2 code=0 child
    shift 2
    rm -rf work && mkdir work
    echo 'the old file' >work/out
    set -m # or it would be deaf to SIGINT
    "$metanode" "$@" work/out >"$out" 2>"$err" &
    set +m
    child=$!
    sleep 0.4
    kill "-$signal" "$child" 2>/dev/null || true
    wait "$child" 2>/dev/null || code=$?
    if [[ $code -eq 0 ]]; then
        skip "$name: it was done before the signal came"
        return
    fi
    if [[ $signal == KILL ]]; then
        check "$name: exit $code" test "$code" -eq 137
    else
        check "$name: exit $code" test "$code" -eq 1
        one_line "$name" "interrupted by SIG$signal"
    fi
    [[ $name != build*KILL ]] || rm -r work/out.work # for --resume; e2e_kill.sh has what it is good for
    still "$name" work/out
}

interrupts() {
    local signal
    expect 0 mountains make terrain --triangles 700000 -o mountains.ply || return 0
    for signal in INT TERM HUP KILL; do
        interrupted "build, SIG$signal" $signal build mountains.ply -o
        interrupted "make, SIG$signal" $signal make isosurface --triangles 3000000 -o
    done
}

expect 0 ball make sphere --triangles 9000 -o ball.ply || finish
expect 0 ball build ball.ply -o ball.mnt || finish
expect 0 hills make terrain --triangles 60000 -o hills.ply || finish
expect 0 hills build hills.ply -o small.mnt --block-bytes 4K || finish
expect 0 trace replay small.mnt --path orbit --io sim --frames 200 --trace t.trace || finish
expect 0 ball simplify ball.ply -o ball.vdt || finish
part no_place
part shut_disk
part full_disk
part limited_files
part over_the_input
part interrupts
finish
