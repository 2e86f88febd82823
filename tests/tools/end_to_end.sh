#!/usr/bin/env bash
# Goal: the whole line as a user types it, from a mesh file to a picture, and every exit code on the way.
# Method: small made models through each subcommand; what one says is checked by another.
# METANODE names the program. Exit 0: all held. What lacks its device is skipped and says so.
set -euo pipefail

metanode=${METANODE:?the program to test}
scratch=$(mktemp -d "${TMPDIR:-/tmp}/metanode-e2e-XXXXXX")
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"

step=
fail() {
    echo "FAILED: $step: $*" >&2
    [[ ! -s err ]] || sed 's/^/    /' err >&2
    exit 1
}

value() { # file key
    sed -nE "s/^ *\"$2\": \"?([^\",]*)\"?,?\$/\1/p" "$1" | head -1
}

# Runs the program; its output is in the file out, its messages in err.
run() { # exit-code argument…
    local expected=$1 code=0
    shift
    step="metanode $*"
    "$metanode" "$@" >out 2>err || code=$?
    [[ $code -eq $expected ]] || fail "exit $code, not $expected"
    if [[ $expected -ne 0 && $(wc -l <err) -ne 1 ]]; then
        fail "one line was to say what is wrong"
    fi
}

equal() { [[ $1 == "$2" ]] || fail "${3-}: $1 is not $2"; }
less() { awk "BEGIN {exit !($1 <= $2)}" || fail "${3-}: $1 is above $2"; }

# A model, both blockings, and what can be asked of the files.
line() { # name file
    local name=$1 mesh=$2 triangles blocking
    for blocking in packed levels; do
        run 0 build "$mesh" -o "$name-$blocking.mnt" --blocking "$blocking" --json
        cp out build.json
        triangles=$(value build.json triangles)
        run 0 verify "$name-$blocking.mnt" --against "$mesh" --json
        run 0 info "$name-$blocking.mnt" --json
        equal "$(value out triangles)" "$triangles" triangles
        equal "$(value out blocks)" "$(value build.json blocks)" blocks
    done
    run 0 simplify "$mesh" -o "$name.vdt"
    run 0 block "$name.vdt" -o again.mnt --blocking levels -L 5
    cmp again.mnt "$name-levels.mnt" || fail "two halves give another file than build"

    run 0 extract "$name-packed.mnt" --full -o full.ply
    run 0 compare "$mesh" full.ply --json
    less "$(value out max)" 1e-5 "full detail is the input"
    run 0 build full.ply -o full.mnt --json
    equal "$(value out triangles)" "$triangles" "full detail, triangle for triangle"
    run 0 extract "$name-packed.mnt" --triangles $((triangles / 10)) -o tenth.ply
    run 0 build tenth.ply -o tenth.mnt --json
    less "$(value out triangles)" $((triangles / 10)) "a tenth"
    less $((triangles / 10 - triangles / 50)) "$(value out triangles)" "a tenth"
}

# The settled front of each frame is the same whatever gives the blocks.
fronts() { # file path
    local file=$1 path=$2 store
    for store in paged mapped resident; do
        run 0 replay "$file" --path "$path" --store "$store" --frames 24 --barrier --degrade off \
            --fps 0 --settle --json --csv "$store.csv"
        equal "$(value out back_at_roots)" true "back at the roots"
        equal "$(value out allocations_after_seal)" 0 allocations
        awk -F, 'NR == 1 {for (i = 1; i <= NF; i++) if ($i == "front_hash") c = i} {print $c}' \
            "$store.csv" >"$store.fronts"
        [[ $(sort -u "$store.fronts" | wc -l) -gt 2 ]] || fail "the front does not move"
        cmp "$store.fronts" paged.fronts || fail "$store has other fronts than paged"
    done
}

run 0 make sphere --triangles 20000 -o sphere.ply
run 0 make terrain --triangles 20000 --seed 7 -o terrain.ply
run 0 make isosurface --triangles 20000 -o isosurface.ply
run 0 make terrain --triangles 20000 --seed 7 -o terrain-again.ply
cmp terrain.ply terrain-again.ply || fail "the same seed makes another terrain"
for model in sphere terrain isosurface; do
    line "$model" "$model.ply"
done
for path in orbit dive flyover; do
    fronts terrain-packed.mnt "$path"
    fronts sphere-levels.mnt "$path"
done

# Under a cap, with all that can be asked of the figures.
for path in orbit dive flyover; do
    run 0 replay sphere-packed.mnt --path "$path" --ram 16M --frames 60 --fps 0 --settle --json
    less "$(value out rss_peak_bytes)" $((16 << 20)) "the cap"
    equal "$(value out allocations_after_seal)" 0 allocations
    equal "$(value out back_at_roots)" true "back at the roots"
done
run 5 replay sphere-packed.mnt --path orbit --ram 1M -K min
smallest=$(sed -nE 's/.*--ram ([0-9]+[KMG]?).*/\1/p' err)
run 0 replay sphere-packed.mnt --path dive --ram "$smallest" -K min --frames 30 --settle --json
equal "$(value out back_at_roots)" true "back at the roots"

# Pictures, where there is a way to draw.
code=0
"$metanode" shoot sphere-packed.mnt --path orbit --frame 10 --ram 16M --size 320x240 -o a.png \
    >out 2>err || code=$?
if [[ $code -eq 6 ]]; then
    echo "pictures skipped: $(cat err)"
else
    step=shoot
    equal "$code" 0 "exit"
    run 0 shoot sphere-packed.mnt --path orbit --frame 10 --store resident --size 320x240 -o b.png
    cmp a.png b.png || fail "another picture with another store"
    equal "$(head -c 8 a.png | od -An -tx1 | tr -d ' ')" 89504e470d0a1a0a "a PNG"
fi

# OpenMesh's helper, where it was built.
if [[ -x $(dirname "$metanode")/metanode-openmesh ]]; then
    run 0 make subdivide sphere.ply --times 1 -o fine.ply
    run 0 build sphere.ply -o a.mnt --json
    triangles=$(value out triangles)
    run 0 build fine.ply -o b.mnt --json
    equal "$(value out triangles)" $((4 * triangles)) "four triangles for one"
    run 0 bench simplify sphere.ply --globe 64 --runs 1 --samples 10000 --json
fi

# Wrong usage and bad input.
run 2 no-such-command
run 2 build
run 2 build sphere.ply -o x.mnt --blocking diagonal
run 2 replay sphere-packed.mnt --path
run 2 replay sphere-packed.mnt --path orbit --ram nothing
run 3 build missing.ply -o x.mnt
run 3 build . -o x.mnt
head -c 1000 sphere.ply >cut.ply
run 3 build cut.ply -o x.mnt
head -c 100000 sphere-packed.mnt >cut.mnt
run 3 verify cut.mnt
run 3 replay cut.mnt --path orbit
run 5 build sphere.ply -o x.mnt --ram 64K
[[ ! -e x.mnt ]] || fail "a failed build left a file behind"
if ls ./*.tmp* >/dev/null 2>&1; then
    fail "a temporary file was left behind"
fi
echo "the whole line holds"
