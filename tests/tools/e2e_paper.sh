#!/usr/bin/env bash
# Goal: bench/paper fills both tables for a model, each cell once, goes on where it stopped, refuses to mix
# settings, and its JSON and plots are whole.
# Method: a made model, few frames, two caps; with cgroups where they can be made.
# e2e_paper.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
cd "$scratch"

expect 0 hills make terrain --triangles 4000 --seed 3 -o hills.ply || finish

paper() { # CAPS OUT
    METANODE=$metanode MODELS=models FRAMES=5 FPS=0 SIZE=320x240 CAPS=$1 OUT=$2 \
        "$root/bench/paper" hills.ply >"$out" 2>"$err"
}

rows() { # table: of the model
    grep -c '^hills,' "first/table$1.csv"
}

check "a run of one cap" paper 48M first || finish
holds "table 1: a row" "$(rows 1) == 1"
holds "table 2: everything resident, and three stores" "$(rows 2) == 4"
holds "a row has its columns" "$(awk -F, 'NR == 1 {n = NF} NF != n {bad++} END {print bad + 0}' first/table2.csv) == 0"
holds "all ran but what was refused" "$(awk -F, 'NR > 1 && $5 != "ok" && $5 != "N/A"' first/table2.csv | wc -l) == 0"
cp first/table2.csv before.csv
check "another cap" paper "48M 1/4" first
holds "its cells are added" "$(rows 2) == 7"
check "what was there has stayed" cmp -n "$(wc -c <before.csv)" before.csv first/table2.csv
cp first/table2.csv before.csv
check "nothing left to do" paper "48M 1/4" first
check "and nothing done" cmp before.csv first/table2.csv
for word in hills David 'place holders for 1/4'; do
    check "the tables name $word" grep -q "$word" first/table2.txt
done
check "paper.json is JSON" python3 -c '
import json
paper = json.load(open("first/paper.json"))
assert len(paper["table1"]) == 1 and len(paper["table2"]) == 7
assert paper["table2"][0]["store"] == "resident" and paper["table2"][0]["triangles_mean"] > 0'
if command -v gnuplot >/dev/null; then
    for plot in build-time tree-size frame-time misses; do
        check "$plot.svg ends" grep -q '</svg>' "first/plots/$plot.svg"
        check "$plot.png" test -s "first/plots/$plot.png"
    done
else
    skip "plots: there is no gnuplot"
fi
if METANODE=$metanode MODELS=models FRAMES=6 OUT=first "$root/bench/paper" hills.ply >"$out" 2>"$err"; then
    fail "two settings are mixed"
else
    check "two settings are not mixed" grep -q 'name another OUT' "$err"
fi
finish
