#!/usr/bin/env bash
# Goal: tune sweeps what it is asked for, keeps what it has measured, and mixes nothing in. Method:
# sweeps of a small made model through the program; its results read as CSV and JSON.
source "$(dirname "$0")/e2e_lib.sh"

dir=$scratch/t
results=$dir/results.csv
expect 0 make make sphere --triangles 6000 -o "$scratch/s.ply"

tune() { # code name option…: a sweep of four settings and what everything in memory would give
    local want=$1 name=$2
    shift 2
    expect "$want" "$name" tune "$scratch/s.ply" -o "$dir" --levels 4 --block-bytes 4K --k 1/2,min \
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

part whole
part more
part torn
part others
finish
