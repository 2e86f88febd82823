#!/usr/bin/env bash
# Goal: whenever a build is killed, there is no output or a whole one, and --resume ends with the same bytes,
# whatever memory and threads it has; likewise when its disk fills, or its memory is too little; whenever it is interrupted, it leaves nothing.
# Method: builds that are killed (and those that go on after it), interrupted, or robbed of their disk, at
# moments that a seed decides; and killed right after each phase. MN_SEED replays the moments, as far as a clock can; TIMES is how many
# kills (50).
# e2e_kill.sh [BUILD]
if [[ -z ${KILL_INSIDE-} ]] && unshare -rm true 2>/dev/null; then # a user may mount disks there
    KILL_INSIDE=1 exec unshare -rm "$0" "$@"
fi
source "$(dirname "$0")/e2e_lib.sh"
cd "$scratch"
seed=${MN_SEED:-$(od -An -N3 -tu4 /dev/urandom | tr -d ' ')}
times=${TIMES:-50}
RANDOM=$((seed % 32768))
echo "seed $seed"

now_ms() { date +%s%3N; }

# A moment of a run that takes `whole_ms`, a little after its end included, in seconds.
moment() { awk -v r=$RANDOM -v w="$whole_ms" 'BEGIN {printf "%.3f", 1.1 * w / 1000 * r / 32768}'; }

# begin ARGUMENT…: metanode in the background, with signals as at a terminal; its number in $child.
begin() {
    set -m
    "$metanode" "$@" >"$out" 2>"$err" </dev/null &
    set +m
    child=$!
}

# Its exit code in $code.
await() {
    code=0
    wait "$child" 2>/dev/null || code=$?
}

# resumed NAME OUT: goes on with another amount of memory and threads, to the same bytes.
resumed() {
    local ways=("" "--ram 16M" "-j 1" "--work-ram 12M -j 3")
    local way=${ways[$((RANDOM % 4))]}
    # shellcheck disable=SC2086 # options are words
    expect 0 "$1, resumed $way" build model.ply -o "$2" --resume $way || return 1
    one_line "$1, resumed" work
    sed -nE 's/.*: (goes on after [a-z]+|[^:]*from the beginning)$/\1/p' "$err" >>notes
    check "$1, resumed $way: the same bytes" cmp whole.mnt "$2"
    [[ $(dirname "$2") = . ]] || # among other files
        check "$1, resumed: no more than that" test "$(ls -A "$(dirname "$2")")" = "$(basename "$2")"
}

# killed NAME ARGUMENT…: a build that is killed at some moment; what it leaves is a whole output, or what stood
# there, and no temporary name where nothing did.
killed() {
    local name=$1 stood=nothing
    if [[ -e here/out.mnt ]]; then
        cp here/out.mnt stood.mnt && stood=stood.mnt
    fi
    begin build model.ply -o here/out.mnt "${@:2}"
    sleep "$(moment)"
    kill -KILL "$child" 2>/dev/null || true
    await
    if [[ $code -eq 137 && $stood == nothing && ! -e here/out.mnt ]] ||
        { [[ $code -eq 137 && $stood != nothing ]] && cmp -s stood.mnt here/out.mnt; }; then
        pass
    else
        check "$name: exit $code, a whole output" cmp whole.mnt here/out.mnt || true
    fi
    if [[ $stood == nothing ]]; then
        check "$name: no temporary name" test -z "$(find here -name '.*' -type f)" || true
    fi
}

kills() {
    local i
    for ((i = 0; i < times; i++)); do
        rm -rf here && mkdir here
        if [[ $((i % 3)) -eq 0 ]]; then
            echo "what stood there" >here/out.mnt
        fi
        killed "kill $i"
        if [[ $((i % 2)) -eq 0 ]]; then # who goes on may be killed as well
            killed "kill $i, again" --resume
        fi
        resumed "kill $i" here/out.mnt || return 0
    done
    sort notes | uniq -c | sed 's/^ */    of the resumed: /'
}

# Killed when the state says that phase N is finished.
after_each_phase() {
    local phase kept names=(- reading simplifying ordering)
    for phase in 1 2 3; do
        rm -rf here && mkdir here
        begin build model.ply -o here/out.mnt --ram 16M
        kept=0
        while kill -0 "$child" 2>/dev/null && [[ $kept -lt $phase ]]; do
            kept=$(od -An -j8 -N1 -tu1 here/out.mnt.work/state 2>/dev/null | tr -d ' ') || true
            kept=${kept:-0}
        done
        kill -KILL "$child" 2>/dev/null || true
        await
        if [[ $code -ne 137 ]]; then
            skip "phase $phase: it was over before it could be killed"
            continue
        fi
        : >notes
        resumed "after phase $phase" here/out.mnt || continue
        check "after phase $phase: it goes on there, or later" \
            grep -qE "goes on after ($(IFS='|' && echo "${names[*]:phase}"))" notes
        # whoever does not ask to resume clears what is left of a kill
        rm -rf here && mkdir here
        begin build model.ply -o here/out.mnt
        sleep "$(moment)"
        kill -KILL "$child" 2>/dev/null || true
        await
        expect 0 "after a kill, anew" build model.ply -o here/out.mnt
        check "anew: the same bytes" cmp whole.mnt here/out.mnt
        check "anew: no more than that" test "$(ls -A here)" = out.mnt
    done
}

refusals() {
    rm -rf here && mkdir here
    begin build model.ply -o here/out.mnt
    while kill -0 "$child" 2>/dev/null && [[ ! -e here/out.mnt.work/state ]]; do :; done
    kill -STOP "$child" 2>/dev/null || true
    if [[ ! -e here/out.mnt.work/state ]]; then
        skip "refusals: it was over before it could be stopped"
        kill -CONT "$child" 2>/dev/null || true
        await
        return 0
    fi
    expect 1 "two builds of one output" build model.ply -o here/out.mnt --resume && one_line "two builds" work "another build"
    kill -KILL "$child"
    kill -CONT "$child" 2>/dev/null || true
    await
    expect 2 "other options" build model.ply -o here/out.mnt --resume --metric length && one_line "other options" options --resume
    cp -p model.ply copy.ply
    touch model.ply
    expect 3 "another mesh" build model.ply -o here/out.mnt --resume && one_line "another mesh" changed --resume
    touch -r copy.ply model.ply
    resumed "after refusals" here/out.mnt
    # another output of that name, with the same --temp-dir, is another build
    mkdir -p temp there
    begin build model.ply -o here/out.mnt --temp-dir temp
    expect 0 "beside another" build model.ply -o there/out.mnt --temp-dir temp
    await
    check "both are built" test "$code" -eq 0
    check "both are the same" cmp here/out.mnt there/out.mnt
    check "and nothing is left" test -z "$(ls -A temp)"
}

interrupts() {
    local i signal signals=(INT TERM HUP)
    for ((i = 0; i < times / 3; i++)); do
        signal=${signals[$((i % 3))]}
        rm -rf here && mkdir here
        begin build model.ply -o here/out.mnt
        sleep "$(moment)"
        kill "-$signal" "$child" 2>/dev/null || true
        await
        if [[ $code -eq 0 ]]; then
            check "SIG$signal $i: a whole output" cmp whole.mnt here/out.mnt
            rm here/out.mnt
        elif [[ $code -gt 128 ]]; then # before it had begun to listen
            pass
        else
            check "SIG$signal $i: exit $code" test "$code" -eq 1
            one_line "SIG$signal $i" "interrupted by SIG$signal" "no finished phase is kept"
        fi
        check "SIG$signal $i: nothing is left" test -z "$(ls -A here)"
    done
}

# Under nohup a build goes on.
nohups() {
    rm -rf here && mkdir here
    trap '' HUP
    begin build model.ply -o here/out.mnt
    trap - HUP
    sleep "$(moment)"
    kill -HUP "$child" 2>/dev/null || true
    await
    check "nohup: exit $code" test "$code" -eq 0
    check "nohup: a whole output" cmp whole.mnt here/out.mnt
}

# A disk with room enough when the build begins, which somebody else fills meanwhile.
full_disks() {
    local i planned kept=0
    mkdir -p disk
    if ! mount -t tmpfs -o size=1m none disk 2>"$err"; then
        skip "no disk can be mounted ($(head -n 1 "$err"))"
        return 0
    fi
    expect 4 "a disk without room" build model.ply -o out.mnt --temp-dir disk &&
        one_line "a disk without room" out.mnt disk "MB are needed" "1.0 MB are free" --temp-dir
    check "a disk without room: nothing is left" test -z "$(ls -A disk)"
    umount disk
    expect 0 planned build model.ply -o out.mnt --ram 16M --json
    planned=$(figures temp_bytes_planned)
    holds "the peak is within the plan" "$(figures temp_bytes_peak) <= $planned"
    rm out.mnt
    for ((i = 0; i < times / 3 + 4; i++)); do
        mount -t tmpfs -o "size=$((planned + (1 << 20)))" none disk
        begin build model.ply -o out.mnt --ram 16M --temp-dir disk
        if [[ $((i % 4)) -eq 0 ]]; then
            sleep "$(moment)"
        else # right after a phase
            while kill -0 "$child" 2>/dev/null && ! compgen -G "disk/*.work/$((i % 4))-0" >/dev/null; do :; done
        fi
        head -c "$((planned * 2))" /dev/zero >disk/full 2>/dev/null || true
        await
        if [[ $code -eq 0 ]]; then
            check "full disk $i: a whole output" cmp whole.mnt out.mnt
            rm disk/full
        else
            check "full disk $i: exit $code" test "$code" -eq 4
            one_line "full disk $i" space
            check "full disk $i: no output" test ! -e out.mnt
            rm disk/full
            if [[ -e out.mnt.work ]]; then # a phase was finished; what --temp-dir was is remembered
                one_line "full disk $i" kept --resume
                check "full disk $i: one folder is left" test "$(ls -A disk)" = "$(basename "$(readlink out.mnt.work)")"
                check "full disk $i: only a state and its files" test "$(find disk -name '[0-9]-*' | sed 's/.*\///; s/-.*//' | sort -u | wc -l)" -eq 1
                : >notes
                resumed "full disk $i" out.mnt && kept=$((kept + 1))
                check "full disk $i: it goes on" grep -q "goes on after" notes
            fi
        fi
        check "full disk $i: nothing is left" test -z "$(ls -A disk)$(find . -maxdepth 1 -name out.mnt.work)"
        rm -f out.mnt
        umount disk
    done
    echo "    of the full disks $kept were gone on with"
    check "some full disks are gone on with" test "$kept" -gt 0
}

# corners VERTICES TRIANGLES: a mesh whose triangles join places all over it.
corners() {
    awk -v seed="$seed" -v v="$1" -v t="$2" 'BEGIN {
        srand(seed)
        print "ply\nformat ascii 1.0\nelement vertex " v "\nproperty float x\nproperty float y\nproperty float z"
        print "element face " t "\nproperty list uchar int vertex_indices\nend_header"
        for (i = 0; i < v; i++) print rand(), rand(), rand()
        for (i = 0; i < t; i++) {
            a = int(v * rand()); b = (a + 1 + int((v - 1) * rand())) % v
            do c = int(v * rand()); while (c == a || c == b)
            print 3, a, b, c
        }
    }'
}

# globe MERIDIANS PARALLELS: a rough one, of which rounds can do little: two poles, slivers beside them.
globe() {
    awk -v seed="$seed" -v m="$1" -v p="$2" 'BEGIN {
        srand(seed)
        pi = atan2(0, -1)
        last = m * (p - 1) + 1
        print "ply\nformat ascii 1.0\nelement vertex " last + 1 "\nproperty float x\nproperty float y\nproperty float z"
        print "element face " 2 * m * (p - 1) "\nproperty list uchar int vertex_indices\nend_header\n0 1 0"
        for (i = 1; i < p; i++)
            for (k = 0; k < m; k++) {
                a = pi * i / p; b = 2 * pi * k / m; r = 1 + 0.01 * sin(7 * a + 5 * b) + 0.003 * rand()
                print r * sin(a) * cos(b), r * cos(a), r * sin(a) * sin(b)
            }
        print "0 -1 0"
        for (k = 0; k < m; k++) print 3, 0, 1 + (k + 1) % m, 1 + k
        for (i = 0; i < p - 2; i++)
            for (k = 0; k < m; k++) {
                a = 1 + i * m + k; b = 1 + i * m + (k + 1) % m
                print 3, a, b, b + m
                print 3, a, b + m, a + m
            }
        for (k = 0; k < m; k++) print 3, last, last - m + k, last - m + (k + 1) % m
    }'
}

# flat SIDE: a grid in which every collapse costs the same.
flat() {
    awk -v n="$1" 'BEGIN {
        print "ply\nformat ascii 1.0\nelement vertex " n * n "\nproperty float x\nproperty float y\nproperty float z"
        print "element face " 2 * (n - 1) * (n - 1) "\nproperty list uchar int vertex_indices\nend_header"
        for (i = 0; i < n; i++) for (k = 0; k < n; k++) print i, k, 0
        for (i = 0; i < n - 1; i++)
            for (k = 0; k < n - 1; k++) {
                a = i * n + k
                print 3, a, a + 1, a + n
                print 3, a + 1, a + n + 1, a + n
            }
    }'
}

# Rounds that do little leave more on the disk than memory that is enough for others keeps off it.
plan_of_slow_rounds() {
    globe 1500 200 >slow.ply
    expect 0 poles build slow.ply -o slow.mnt --ram 1G --json &&
        holds "poles: the peak is within the plan" "$(figures temp_bytes_peak) <= $(figures temp_bytes_planned)"
    flat 400 >slow.ply
    expect 0 flat build slow.ply -o slow.mnt --ram 24M -j 3 --json &&
        holds "flat: the peak is within the plan" "$(figures temp_bytes_peak) <= $(figures temp_bytes_planned)"
    rm slow.ply slow.mnt
}

# What triangles take that cross the model is known when they have been read: the plan is another then.
plan_of_corners() {
    local planned
    corners 3000 60000 >corners.ply
    expect 0 corners build corners.ply -o corners.mnt --ram 24M --json || return 0
    planned=$(figures temp_bytes_planned)
    holds "corners: the peak is within the plan" "$(figures temp_bytes_peak) <= $planned"
    check "corners: sound" "$metanode" verify corners.mnt --against corners.ply
    mkdir -p disk
    if ! mount -t tmpfs -o "size=$((planned / 2))" none disk 2>"$err"; then
        skip "no disk can be mounted ($(head -n 1 "$err"))"
        return 0
    fi
    expect 4 "corners: half a disk" build corners.ply -o again.mnt --ram 24M --temp-dir disk &&
        one_line "corners: half a disk" again.mnt "MB are needed" reading kept --resume
    check "corners: no output" test ! -e again.mnt
    mount -o "remount,size=$((planned + (1 << 20)))" disk
    expect 0 "corners: more disk" build corners.ply -o again.mnt --ram 24M --resume
    check "corners: the same bytes" cmp corners.mnt again.mnt
    check "corners: nothing is left" test -z "$(ls -A disk)"
    umount disk
}

# What a part takes that cannot be cut is known when the mesh has been read: who has more memory goes on there.
more_memory() {
    corners 30000 40000 >loose.ply
    expect 0 "loose corners" build loose.ply -o loose.mnt --ram 32M || return 0
    expect 5 "too little memory" build loose.ply -o more.mnt --ram 12M &&
        one_line "too little memory" "try --ram" reading kept --resume
    check "too little memory: no output" test ! -e more.mnt
    expect 0 "more memory" build loose.ply -o more.mnt --ram 32M --resume && one_line "more memory" reading
    check "more memory: the same bytes" cmp loose.mnt more.mnt
    check "more memory: nothing is left" test ! -e more.mnt.work
}

# A --temp-dir that is forgotten is remembered; one that holds nothing is refused.
elsewhere() {
    rm -rf here temp && mkdir here temp other
    begin build model.ply -o here/out.mnt --temp-dir temp
    while kill -0 "$child" 2>/dev/null && ! compgen -G "temp/out.mnt-*.work/state" >/dev/null; do :; done
    kill -KILL "$child" 2>/dev/null || true
    await
    if ! compgen -G "temp/out.mnt-*.work/state" >/dev/null; then
        skip "elsewhere: it was over before it could be killed"
        return 0
    fi
    expect 2 "another --temp-dir" build model.ply -o here/out.mnt --resume --temp-dir other &&
        one_line "another --temp-dir" here/out.mnt kept temp/out.mnt --temp-dir
    : >notes
    resumed "elsewhere" here/out.mnt
    check "elsewhere: it goes on" grep -q "goes on after" notes
    check "elsewhere: nothing is left" test -z "$(find temp other -mindepth 1)"
}

# killed_at PLACE: a build killed with a phase finished, its folder beside the output or in a --temp-dir.
killed_at() {
    rm -rf here temp other && mkdir here temp other
    local option=()
    [[ $1 == here ]] || option=(--temp-dir "$1")
    begin build model.ply -o here/out.mnt "${option[@]}"
    while kill -0 "$child" 2>/dev/null && [[ -z $(find here temp -path '*.work/state') ]]; do :; done
    kill -KILL "$child" 2>/dev/null || true
    await
    [[ -n $(find here temp -path '*.work/state') ]]
}

# Begun again with another --temp-dir, or with none, it clears the folder that nobody would look for.
moved() {
    local from to option
    for from in here temp; do
        for to in here other; do
            option=()
            [[ $to == here ]] || option=(--temp-dir "$to")
            if [[ $from == "$to" ]]; then
                continue
            elif ! killed_at "$from"; then
                skip "from $from to $to: it was over before it could be killed"
                continue
            fi
            expect 0 "from $from to $to" build model.ply -o here/out.mnt "${option[@]}"
            check "from $from to $to: the same bytes" cmp whole.mnt here/out.mnt
            check "from $from to $to: without a word" test ! -s "$err"
            check "from $from to $to: nothing is left" test "$(find here temp other -mindepth 1)" = here/out.mnt
        done
    done
    # What is no build's stays, and it is said.
    killed_at temp || return 0
    touch "$(readlink here/out.mnt.work)/mine"
    expect 0 "what is no build's" build model.ply -o here/out.mnt --temp-dir other
    one_line "what is no build's" "stays" "mine"
    check "what is no build's stays" test -n "$(find temp -name mine)"
}

# begins_anew NAME WORD…: with --resume, a line that says why from the beginning, and the same bytes.
begins_anew() {
    expect 0 "$1, --resume" build model.ply -o here/out.mnt --resume && one_line "$@" "from the beginning"
    check "$1: the same bytes" cmp whole.mnt here/out.mnt
    check "$1: nothing is left" test "$(find here temp other -mindepth 1 2>/dev/null)" = here/out.mnt
}

# refused NAME WORD…: a line that says what stands in the way, which stands yet.
refused() {
    local before
    before=$(ls -AR here)
    expect 1 "$1" build model.ply -o here/out.mnt --resume && one_line "$@"
    check "$1: all is as it was" test "$(ls -AR here)" = "$before"
}

# What was kept has gone with its disk, in part, or is something else by now.
gone() {
    if ! killed_at temp; then
        skip "gone: it was over before it could be killed"
        return 0
    fi
    mv temp away # as when its disk is not mounted
    refused "a folder that is gone" here/out.mnt "temp/out.mnt" "not there" "leave out --resume"
    mv away temp
    : >notes
    resumed "its disk is back" here/out.mnt
    check "its disk is back: it goes on" grep -q "goes on after" notes
    if killed_at temp; then
        rm -r temp
        expect 0 "gone, anew" build model.ply -o here/out.mnt
        check "gone, anew: without a word" test ! -s "$err"
        check "gone, anew: the link goes too" test "$(ls -A here)" = out.mnt
    fi
    killed_at temp && rm -r temp/*.work && begins_anew "an empty disk" "nothing to go on from"
    killed_at here && rm here/out.mnt.work/state && begins_anew "no state" "no phase"
    killed_at here && rm here/out.mnt.work/[123]-0 && begins_anew "a file is gone" "not whole"
    killed_at here && truncate -s -1 here/out.mnt.work/[123]-0 && begins_anew "a file is short" "not whole"
    if killed_at here; then
        rm here/out.mnt.work/[123]-0
        mkdir here/out.mnt.work/1-0
        refused "a folder in a file's place" here/out.mnt.work 1-0 "not of a build"
        rm -r here/out.mnt.work
        echo mine >here/out.mnt.work
        refused "a file in the folder's place" here/out.mnt.work "not a folder"
    fi
}

expect 0 model make terrain --triangles 60000 -o model.ply || finish
begun_ms=$(now_ms)
expect 0 whole build model.ply -o whole.mnt || finish
whole_ms=$(($(now_ms) - begun_ms))
expect 0 sound verify whole.mnt --against model.ply
: >notes
part kills
part after_each_phase
part refusals
part interrupts
part nohups
part full_disks
part plan_of_corners
part plan_of_slow_rounds
part more_memory
part elsewhere
part moved
part gone
finish
