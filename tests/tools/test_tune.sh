#!/usr/bin/env bash
# Goal: tune sweeps what it is asked for, keeps what it has measured, and mixes nothing in. Method:
# sweeps of a small made model through the program; its results read as CSV and JSON.
source "$(dirname "$0")/e2e_lib.sh"

dir=$scratch/t
tools=/nowhere # without gnuplot sweeps are over sooner
results=$dir/results.csv
expect 0 make make sphere --triangles 6000 -o "$scratch/s.ply"

tune() { # code name option…: a sweep of four settings and what everything in memory would give
    local want=$1 name=$2
    shift 2
    PATH=$tools expect "$want" "$name" tune "$scratch/s.ply" -o "$dir" --levels 4 --block-bytes 4K --k 1/2,min \
        --path orbit --prefetch ahead --frames 6 --fps 0 "$@"
}
cells() { grep -cv '^layout,' "$results" || true; }

whole() {
    tune 0 whole --json
    equal whole best_prefetch ahead
    check "whole: five cells" test "$(cells)" -eq 5
    check "whole: each measured" test "$(grep -c ',0,"",' "$results")" -eq 5
    cp "$results" "$scratch/first.csv"
    tune 0 again
    check "again: nothing is measured twice" cmp "$results" "$scratch/first.csv"
    check "again: the table" grep -q '^packed-4K .* min ' "$out"
    check "again: kept as a file" grep -q '^packed-4K .* min ' "$dir/table.txt"
}

more() {
    tune 0 more --k 1/2,min,9
    check "more: two cells more" test "$(cells)" -eq 7
    check "more: the others stand" cmp <(head -6 "$results") "$scratch/first.csv"
}

torn() {
    head -c -20 "$scratch/first.csv" >"$results"
    tune 0 torn
    check "torn: the last one again" test "$(cells)" -eq 5
    check "torn: the others stand" cmp <(head -5 "$results") <(head -5 "$scratch/first.csv")
    sed -i '3s/,[^,]*$/,what/' "$results"
    tune 3 damaged
    one_line damaged 'line 3' --fresh
    tune 0 fresh --fresh
    check "fresh: all of them" test "$(cells)" -eq 5
}

others() {
    tune 2 tolerance --tolerance 2
    one_line tolerance 'tolerance 1' 'tolerance 2' --fresh
    expect 0 make make sphere --triangles 5000 -o "$scratch/other.ply"
    expect 2 input tune "$scratch/other.ply" -o "$dir" --fps 0
    one_line input 'input' --fresh
    mkdir "$scratch/full" && touch "$scratch/full/packed-4K.mnt"
    expect 2 "not ours" tune "$scratch/s.ply" -o "$scratch/full"
    one_line "not ours" 'empty'
    echo hello >"$scratch/full/tune.txt"
    expect 2 "not ours either" tune "$scratch/s.ply" -o "$scratch/full" --fresh
    check "not ours: nothing is lost" test -e "$scratch/full/packed-4K.mnt"
}

# What others had is a share, however short a cell is.
share() {
    tune 0 short --frames 2 --fresh
    check "share: from 0 to 1" test "$(tail -n +2 "$results" | sed 's/.*,//' | awk '$1 > 1 || $1 < 0' | wc -l)" -eq 0
    tune 0 share --fresh
}

# A cell that K is too small for, a path of a file, a tree that is there already, a constraint.
kinds() {
    local csv=$scratch/k/results.csv
    printf 'metanode path 1\n0 0 3 0 0 0 0 1 0\n0 0 2 0 0 0 0 1 0\n' >"$scratch/two.path"
    expect 0 simplify simplify "$scratch/s.ply" -o "$scratch/s.vdt"
    PATH=$tools expect 0 kinds tune "$scratch/s.vdt" -o "$scratch/k" --policy packed --block-bytes 4K --k 2,min --fps 0 \
        --path "$scratch/two.path" --frames 4 --cross --error-px 0.001
    check "kinds: too small, and why" grep -q '^packed-4K,0,2,two.path@[0-9a-f]*:4,ahead,[1-9][0-9]*,"[^"]*place holders' "$csv"
    check "kinds: in the table too" grep -q 'packed-4K .* 2 .*needs at least' "$out"
    check "kinds: every rule" test "$(cut -d, -f5 "$csv" | sort -u | tr '\n' ' ')" = \
        'ahead neighbours off prefetch resident '
    check "kinds: nothing is best" grep -q 'no setting keeps to that' "$out"
    check "kinds: the tree is left where it is" test ! -e "$scratch/k/tree.vdt"
    PATH=$tools expect 1 late tune "$scratch/s.vdt" -o "$scratch/k" --policy packed --block-bytes 4K --k min --fps 0 \
        --path orbit --frames 1000000 --prefetch ahead --limit 1
    one_line late 'no setting could be measured: took more than 1 s'
    check "late: nothing is best" test "$(grep -c best "$out")" -eq 0
    PATH=$tools expect 0 caps tune "$scratch/s.vdt" -o "$scratch/c" --policy packed --block-bytes 4K --caps 8M,1M --fps 0 \
        --path orbit --frames 4 --prefetch ahead --want "p99 under 1000 ms" --minimize ram
    check "caps: too small, and what would do" grep -q '1M .* would work' "$out"
    PATH=$tools expect 5 small tune "$scratch/s.vdt" -o "$scratch/c" --policy packed --block-bytes 4K --caps 1M --fps 0 \
        --path orbit --frames 4 --prefetch ahead
    one_line small 'no setting could be measured' '--caps 1024K is too small' ': --caps ' 'K would work'
    PATH=$tools expect 5 "small, --ram" tune "$scratch/s.vdt" -o "$scratch/r" --policy packed --block-bytes 4K --ram 2M --fps 0
    one_line "small, --ram" '--ram 2048K is too small' ': --ram ' 'K would work'
    check "small, --ram: nothing was measured" test "$(grep -c packed "$scratch/r/results.csv")" -eq 0
    PATH=$tools expect 0 caps tune "$scratch/s.vdt" -o "$scratch/c" --policy packed --block-bytes 4K --caps 8M,1M --fps 0 \
        --path orbit --frames 4 --prefetch ahead --want "p99 under 1000 ms" --minimize ram
    check "caps: the other is best" grep -q 'packed-4K, K [0-9]* (cap) under 8 MB' "$out"
}

page() {
    local page=$dir/report.html
    tools=$PATH
    tune 0 page
    tools=/nowhere
    check "page: whole" grep -q '</html>' "$page"
    check "page: the command" grep -q 'metanode tune.*--k 1/2,min' "$page"
    check "page: nothing from elsewhere" test "$(grep -cE '(src|href)="?https?:' "$page")" -eq 0
    if command -v gnuplot >/dev/null; then
        check "page: plots" test "$(grep -c 'src="data:image/svg+xml;base64,' "$page")" -ge 4
        for kind in svg png gp; do
            check "plots: error.$kind" test -s "$dir/plots/error-orbit-ahead.$kind"
        done
        check "plots: an SVG whole" grep -q '</svg>' "$dir/plots/heat-orbit-ahead.svg"
    else
        skip "plots: no gnuplot"
    fi
    local path=$PATH code=0
    PATH=/nowhere "$metanode" tune "$scratch/s.ply" -o "$scratch/none" --policy packed --block-bytes 4K --k min \
        --path orbit --prefetch ahead --frames 2 --fps 0 >"$out" 2>"$err" </dev/null || code=$?
    check "no gnuplot: $(cat "$err")" test "$code" -eq 0
    one_line "no gnuplot" gnuplot
    check "no gnuplot: the table" grep -q '^packed-4K ' "$out"
    check "no gnuplot: the page" grep -q 'no plots but their scripts: gnuplot' "$scratch/none/report.html"
    check "no gnuplot: the scripts alone" test "$(ls "$scratch/none/plots" | sed 's/.*\.//' | sort -u)" = gp
}

# Of a busy machine: what others had is in the results, and times are the processor's unless the clock's are asked for.
busy() {
    cp "$scratch/first.csv" "$results"
    sed -i '2,$s/,[^,]*$/,0.95/' "$results"
    tune 0 busy
    check "busy: said" grep -q '^others had 95 to 95 % of the processors.*--clock wall' "$out"
    check "busy: the processor's" grep -q 'times of the processor' "$out"
    check "busy: on the page" grep -q 'others had 95 to 95 %' "$dir/report.html"
    tune 0 "busy, wall" --clock wall
    check "busy, wall: said" grep -q '^others had 95 to 95 % of the processors.*--clock cpu' "$out"
    check "busy, wall: the clock's" grep -q 'times of the clock' "$out"
    tune 0 "busy, cpu" --clock cpu
    check "busy, cpu: not said" test "$(grep -c '^others had' "$out")" -eq 0
    sed -i '2,$s/,[^,]*$/,0.01/' "$results"
    tune 0 quiet
    check "quiet: the clock's" grep -q 'times of the clock' "$out"
    check "quiet: not said" test "$(grep -c '^others had' "$out")" -eq 0
}

# Interrupted in a measured cell: what was measured stays, lines are whole, and it goes on.
interrupt() {
    local d=$scratch/i code=0
    local sweep=(tune "$scratch/s.ply" -o "$d" --policy packed --block-bytes 4K,8K --k 1/2,min --path orbit
        --prefetch ahead --frames 25)
    set -m # or it would be deaf to SIGINT
    "$metanode" "${sweep[@]}" >"$out" 2>"$err" </dev/null &
    set +m
    local child=$!
    for _ in {1..200}; do
        [[ $(cat "$d/results.csv" 2>/dev/null | wc -l) -lt 3 ]] || break
        sleep 0.05
    done
    expect 1 "another one in the folder" "${sweep[@]}"
    one_line "another one in the folder" 'at work'
    kill -INT "$child"
    wait "$child" || code=$?
    "$metanode" --version >"$out"
    check "interrupt: exit $code" test "$code" -eq 1
    check "interrupt: $(cat "$err")" grep -q 'goes on' "$err"
    check "interrupt: no replay is left" test -z "$(pgrep -f "replay $d/" || true)"
    check "interrupt: whole lines" test -z "$(tail -c 1 "$d/results.csv")"
    cp "$d/results.csv" "$scratch/i.csv"
    PATH=$tools expect 0 "goes on" "${sweep[@]}"
    check "goes on: what was measured stands" cmp "$scratch/i.csv" <(head -n "$(wc -l <"$scratch/i.csv")" "$d/results.csv")
    check "goes on: the rest as well" test "$(grep -c ',0,"",' "$d/results.csv")" -eq 5
}

# What the mesh's own program says is all that is said: of a mesh that is none, and where it is
# interrupted while the tree is made.
tree_fails() {
    local code=0
    printf 'ply\nformat ascii 1.0\nelement vertex 3\nend_header\n' >"$scratch/bad.ply"
    expect 3 "a bad mesh" tune "$scratch/bad.ply" -o "$scratch/b" --fps 0
    one_line "a bad mesh" bad.ply
    expect 0 large make terrain --triangles 1M -o "$scratch/large.ply"
    set -m # or it would be deaf to SIGINT
    "$metanode" tune "$scratch/large.ply" -o "$scratch/l" --fps 0 >"$out" 2>"$err" </dev/null &
    set +m
    local child=$!
    for _ in {1..400}; do
        [[ ! -d $scratch/l/tree.vdt.work ]] || break
        sleep 0.02
    done
    kill -TERM "$child"
    wait "$child" || code=$?
    check "interrupt in the tree: exit $code" test "$code" -eq 1
    one_line "interrupt in the tree" 'interrupted by SIGTERM; nothing is left of'
    check "interrupt in the tree: nothing is left" test ! -e "$scratch/l"
    rm -rf "$scratch/large.ply"
    expect 5 "too little to simplify in" tune "$scratch/s.ply" -o "$scratch/l" --fps 0 --build-ram 1M
    one_line "too little to simplify in" 'try --build-ram '
    rm -rf "$scratch/l"
    expect 5 "too little to cut in" tune "$scratch/s.vdt" -o "$scratch/l" --fps 0 --build-ram 1M
    one_line "too little to cut in" 'try --build-ram '
    rm -rf "$scratch/l"
    expect 0 "a layout" block "$scratch/s.vdt" -o "$scratch/whole.mnt"
    head -c 20000 "$scratch/whole.mnt" >"$scratch/cut.mnt"
    expect 3 "a cut .mnt" tune "$scratch/cut.mnt" -o "$scratch/l" --fps 0
    one_line "a cut .mnt" 'cut.mnt: is cut off' 'copy it whole'
}

# Each is one line that names what is wrong, and nothing is made.
usage() {
    local -A wrong=([levels]=17 [block-bytes]=5K [k]=1/0 [caps]=0 [policy]=both [path]=, [prefetch]=on
        [frames]=0 [fps]=-1 [size]=big [tolerance]=0 [degrade]=yes [p99-ms]=-1 [error-px]=x [miss-rate]=2
        [want]='p99 above 4 ms' [limit]=0 [open]=shut [ram]=none [minimize]=all [clock]=sun)
    for option in "${!wrong[@]}"; do
        expect 2 "--$option" tune "$scratch/s.ply" -o "$scratch/u" "--$option" "${wrong[$option]}"
        one_line "--$option" "--$option" "'${wrong[$option]}'"
    done
    for option in p99-ms error-px; do # no setting keeps to nothing
        expect 2 "--$option 0" tune "$scratch/s.ply" -o "$scratch/u" "--$option" 0
        one_line "--$option 0" "--$option" "'0' is not in"
    done
    expect 2 "p99 under 0 ms" tune "$scratch/s.ply" -o "$scratch/u" --want "p99 under 0 ms"
    local list=4
    for i in {2..17}; do list+=,$((4 + i)); done
    expect 2 "17 of them" tune "$scratch/s.ply" -o "$scratch/u" --k "$list"
    one_line "17 of them" 'more than 16'
    expect 2 "the same value twice" tune "$scratch/s.ply" -o "$scratch/u" --block-bytes 4K,8K,4096
    one_line "the same value twice" "'4096' stands there twice"
    expect 2 "the same path twice" tune "$scratch/s.ply" -o "$scratch/u" --path orbit,orbit
    one_line "the same path twice" "'orbit' stands there twice"
    expect 2 "none of them" tune "$scratch/s.ply" -o "$scratch/u" --levels 3,x
    one_line "none of them" "'x' is not in 1 … 16"
    expect 2 "the same bound twice" tune "$scratch/s.ply" -o "$scratch/u" --ram 8M --want "at 24 MB"
    one_line "the same bound twice" 'twice'
    expect 2 "no mesh" tune -o "$scratch/u"
    expect 2 "two meshes" tune a b -o "$scratch/u"
    expect 2 "no folder" tune "$scratch/s.ply"
    mkfifo "$scratch/fifo"
    expect 3 "a fifo" tune "$scratch/fifo" -o "$scratch/u"
    expect 3 "a fifo as path" tune "$scratch/s.ply" -o "$scratch/u" --path "$scratch/fifo"
    expect 3 "no such mesh" tune "$scratch/nope.ply" -o "$scratch/u"
    expect 2 "no such path" tune "$scratch/s.ply" -o "$scratch/u" --path "$scratch/nope" # as of replay
    one_line "no such path" 'neither orbit, dive nor flyover'
    check "usage: nothing was made" test ! -e "$scratch/u"
    rm -rf "$scratch/u"
    expect 3 "no mesh at all" tune "$0" -o "$scratch/u"
    check "no mesh at all: nothing is left of the folder" test ! -e "$scratch/u"
    expect 2 "no folder possible" tune "$scratch/s.ply" -o "$scratch/s.ply"
}

part whole
part more
part torn
part others
part share
part kinds
part busy
part page
part interrupt
part tree_fails
part usage
finish
