#!/bin/sh
# Goal: docs/figures.md names every key that --json prints and every column of --csv, and none besides.
# Method: each command once, on a small made model; usage: test_figures.sh METANODE figures.md
set -u
metanode=$1
page=$2
. "$(dirname "$0")/lines_lib.sh"

: >printed
# keys COMMAND …: its keys stand on the page
keys() {
    expect 0 "$@" --json
    grep -o '"[a-z0-9_]*":' out.txt | tr -d '":' | sort -u >keys
    [ -s keys ] || fail "no keys: $*"
    while read -r key; do
        grep -q "\`$key\`" "$page" || fail "$1: $key is not on the page"
    done <keys
    cat keys >>printed
}

# Without a cap there is none, in every command.
no_cap() {
    grep -q '"ram_cap_bytes": null' out.txt || fail "$1 without a cap: $(grep ram_cap out.txt)"
    grep -q 'ram_cap_bytes": 0' out.txt && fail "$1: no cap is a cap of 0"
}

expect 0 make sphere --triangles 3000 -o in.ply
keys build in.ply -o a.mnt
keys simplify in.ply -o a.vdt
keys block a.vdt -o b.mnt
keys info a.mnt
keys info a.vdt
keys verify a.mnt --against in.ply
keys extract a.mnt --triangles 500 -o x.ply
keys compare in.ply x.ply --samples 100
keys replay a.mnt --path orbit --frames 3 --fps 0 --io sim --settle --trace t.trace --csv t.csv
no_cap replay
keys trace t.trace
keys stress a.mnt --runs 1 --frames 10
keys tune a.mnt -o tuned --policy packed --block-bytes 4K --k min --path orbit --prefetch off --frames 2
no_cap tune
if "$metanode" shoot a.mnt --size 32x32 -o a.png >out.txt 2>&1; then
    keys shoot a.mnt --size 32x32 -o a.png
    no_cap shoot
    keys compare a.png a.png
else
    echo 'picture width height settled gl_driver' | tr ' ' '\n' >>printed
    echo 'psnr_db ssim mean_square identical' | tr ' ' '\n' >>printed
    echo "no graphics: keys of pictures are not looked at"
fi
head -n 1 t.csv | tr ',' '\n' >columns
while read -r column; do
    grep -q "\`$column\`" "$page" || fail "--csv: $column is not on the page"
done <columns

# Of a failure; and what a key of the object is, not its name.
printf '%s\n' failure failure_seed failed exit >>printed
sort -u printed columns >known
sed -n 's/^| \(`[^|]*\) |.*/\1/p' "$page" | grep -o '`[a-z0-9_]*`' | tr -d '`' | sort -u |
    grep -vxFf known >made_up && fail "keys that nothing prints: $(tr '\n' ' ' <made_up)"
exit $((failures > 0))
