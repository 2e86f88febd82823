#!/bin/sh
# Goal: the window answers the mouse and the keys, says in its title what is going on, comes to rest
# without burning a core, and goes at a key.
# Method: the program on a display of its own, driven by xdotool; usage: test_view.sh METANODE.
# Skipped (77) without Xvfb, xdotool or OpenGL.
set -u
metanode=$1
for tool in xvfb-run xdotool; do
    command -v $tool >/dev/null || { echo "skipped: no $tool"; exit 77; }
done
if [ $# -eq 1 ]; then
    exec xvfb-run -a -s '-screen 0 800x600x24 -noreset' "$0" "$metanode" inside
fi
folder=$(mktemp -d) || exit 1
viewer=
trap '[ -z "$viewer" ] || kill $viewer 2>/dev/null; rm -rf "$folder"' EXIT
cd "$folder" || exit 1

fail() {
    echo "FAILED: $*"
    cat out.txt err.txt
    exit 1
}

title() {
    xdotool getwindowname "$window" 2>/dev/null
}

rest='^a\.mnt: still, [0-9]+ triangles, [0-9.]+ MB, [0-9]+ misses, error [0-9.]+ px$'

triangles() {
    title | sed 's/.*, \([0-9]*\) triangles.*/\1/'
}

# Until the window rests, with another number of triangles than that; a minute is long for a busy
# machine.
wait_rest() {
    for _ in $(seq 600); do
        title | grep -Eq "$rest" && [ "$(triangles)" -ne "$1" ] && return
        kill -0 $viewer 2>/dev/null || fail "the viewer has gone"
        sleep 0.1
    done
    fail "$2: no rest with other than $1 triangles: $(title)"
}

ticks() {
    awk '{ print $14 + $15 }' /proc/$viewer/stat
}

"$metanode" make sphere --triangles 60000 -o a.ply >out.txt 2>err.txt &&
    "$metanode" build a.ply -o a.mnt >>out.txt 2>>err.txt || fail "no model"
"$metanode" view a.mnt --ram 16M --tolerance 3 --size 400x300 --trace a.trace >out.txt 2>err.txt &
viewer=$!
for _ in $(seq 300); do
    window=$(xdotool search --name '^a.mnt: ' 2>/dev/null | head -1)
    [ -n "$window" ] && break
    if ! kill -0 $viewer 2>/dev/null; then
        wait $viewer
        code=$?
        viewer=
        [ $code -ne 6 ] || { echo "skipped: $(cat err.txt)"; exit 77; }
        fail "exit $code"
    fi
    sleep 0.1
done
[ -n "$window" ] || fail "no window"

wait_rest 0 start
before=$(ticks)
sleep 2
idle=$(($(ticks) - before))
[ $idle -le 20 ] || fail "$idle hundredths of a second of processor time in 2 s of rest"

# Zoom, turn and pan: each ends in another front.
far=$(triangles)
xdotool mousemove 200 150 click --repeat 6 --delay 30 4
wait_rest "$far" zoom
near=$(triangles)
xdotool mousedown 1 mousemove_relative 120 30 mouseup 1
wait_rest "$near" turn
turned=$(triangles)
xdotool keydown shift mousedown 1 mousemove_relative -- -150 60 mouseup 1 keyup shift
wait_rest "$turned" pan

# Looks, a picture of each, and back.
for look in s ws wls lfs fr; do
    xdotool type --delay 50 $look
    sleep 1
done
for n in 1 2 3 4; do
    [ -s metanode-$n.png ] || fail "no metanode-$n.png"
    [ $n -eq 1 ] || ! cmp -s metanode-1.png metanode-$n.png || fail "look $n is look 1"
done

# Recorded, and never over what is there; flown.
echo mine >metanode-1.path
xdotool type --delay 50 p
sleep 1
xdotool mousemove 200 150 click --repeat 4 --delay 100 4
sleep 1
xdotool type --delay 50 p
sleep 1
[ "$(cat metanode-1.path)" = mine ] || fail "a path was written over"
"$metanode" replay a.mnt --path metanode-2.path --fps 0 >replay.txt 2>&1 || fail "the recording: $(cat replay.txt)"
frames=$(sed -nE 's/^recorded ([0-9]+) frames$/\1/p' out.txt)
[ "$frames" -ge 60 ] && grep -q "^paged *$frames frames" replay.txt || fail "recorded $frames: $(cat replay.txt)"
xdotool type --delay 50 g
sleep 2
xdotool type --delay 50 g
sleep 1
grep -Eq '^flown to frame [0-9]+ of 600$' out.txt || fail "no flight"
xdotool key Escape
wait $viewer
code=$?
viewer=
[ $code -eq 0 ] || fail "exit $code"
"$metanode" trace a.trace >report.txt 2>>err.txt || fail "no trace"
grep -q ' 0 splits' report.txt && fail "a trace of nothing"
[ ! -s err.txt ] || fail "errors are said"
