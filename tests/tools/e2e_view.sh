#!/usr/bin/env bash
# Goal: the window opens, settles, and then burns no core; without a display it says so.
# Method: a display of Xvfb; the processor time of the process while nothing happens.
# e2e_view.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
cd "$scratch"

expect 0 ball make sphere --triangles 20000 -o ball.ply || finish
expect 0 ball build ball.ply -o ball.mnt || finish
unset DISPLAY WAYLAND_DISPLAY
expect 6 "no display" view ball.mnt --ram 16M && one_line "no display" shoot
if ! command -v xvfb-run >/dev/null; then
    skip "the window: there is no xvfb-run"
    finish
fi

# What the process has used of the processor, in hundredths of a second.
cat >watch <<'END'
#!/bin/bash
"$1" view ball.mnt --ram 16M --size 320x240 >view.out 2>view.err &
view=$!
used() { awk '{print $14 + $15}' "/proc/$view/stat" 2>/dev/null || echo 0; }
rest=-1
for ((second = 0; second < 60; second++)); do # until it rests; software draws slowly
    before=$(used)
    sleep 1
    rest=$(($(used) - before))
    [[ $second -lt 2 || $rest -gt 1 ]] || break
done
kill -0 "$view" 2>/dev/null && echo "$rest" >rest
kill "$view"
wait "$view"
END
chmod +x watch
code=0
xvfb-run -a ./watch "$metanode" >"$out" 2>"$err" || code=$?
if [[ ! -s rest ]] && grep -q 'no graphics' view.err; then
    skip "the window: $(cat view.err)"
    finish
fi
check "the window stays open" test -s rest
check "it rests: $(cat rest) hundredths of a second in one" test "$(cat rest)" -le 1
check "its keys are told" grep -q 'wireframe' view.out
check "nothing is wrong" test ! -s view.err
finish
