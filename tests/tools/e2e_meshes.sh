#!/usr/bin/env bash
# Goal: whatever mesh goes in, its tree is sound, full detail is the input, triangle for triangle, and
# what is extracted is what was asked for.
# Method: made models, one for each odd property, and every real one, through build with both
# policies, the two halves of it, info, verify, extract and compare; what one says, another checks.
# e2e_meshes.sh [BUILD [real]]     real: the real models instead of the made ones
source "$(dirname "$0")/e2e_lib.sh"
source "$(dirname "$0")/e2e_shapes.sh"
which=${2-made}
cd "$scratch"

# design.md §5, all of them.
build_keys=(vertices triangles input_faces duplicate_faces degenerate_faces nonfinite_faces
    misoriented_faces unused_vertices welded_vertices merged_positions nonmanifold_edges boundary_edges
    components roots nodes hinges collapses_by_stage virtual_collapses legal_last depth_max block_depth
    blocks fill_mean order_violations rounds collapses_per_second seconds_read seconds_simplify
    seconds_block bytes_read bytes_written file_bytes bytes_per_vertex ram_cap_bytes rss_peak_bytes l
    block_bytes metric blocking)

# built NAME MESH MNT OPTION…: builds, and checks what must hold of any build.
built() {
    local name=$1 mesh=$2 mnt=$3
    shift 3
    expect 0 "$name" build "$mesh" -o "$mnt" --json "$@" || return 1
    check "$name: keys" "$helpers/e2e_json" "${build_keys[@]}" <"$out"
    local v t in dup deg non nodes roots bytes violations cap rss
    read -r v t in dup deg non nodes roots bytes violations cap rss < <(figures vertices triangles \
        input_faces duplicate_faces degenerate_faces nonfinite_faces nodes roots file_bytes \
        order_violations ram_cap_bytes rss_peak_bytes | paste -sd' ')
    holds "$name: in = kept + rejected" "$in == $t + $dup + $deg + $non"
    holds "$name: one tree" "$roots == 1 && $nodes == 2 * $v - 1"
    holds "$name: strict order" "$violations == 0"
    holds "$name: size" "$bytes == $(stat -c %s "$mnt")"
    $sanitized || holds "$name: memory under the cap" "$rss <= $cap"
}

# extracted NAME MNT TRIANGLES: the three levels of detail, and the full one.
extracted() {
    local name=$1 mnt=$2 triangles=$3 percent want got
    expect 0 "$name" extract "$mnt" --full -o full.ply --json || return 0
    equal "$name: full detail" triangles "$triangles"
    expect 0 "$name" build full.ply -o again.mnt --json && equal "$name: again" triangles "$triangles"
    for percent in 50 10 1; do
        want=$((triangles * percent / 100))
        expect 0 "$name" extract "$mnt" --triangles "$want" -o part.ply --json || continue
        got=$(figures triangles)
        holds "$name: $percent %" "$got <= $want && ($loose || $got >= 0.95 * $want - 4)"
        [[ $got -eq 0 ]] || expect 0 "$name: $percent % is a mesh" build part.ply -o again.mnt || true
    done
}

# distances NAME MESH MNT: full detail is where the input is; an error that was asked for is kept.
distances() {
    local name=$1 mesh=$2 mnt=$3 diagonal max error got step
    expect 0 "$name" info "$mnt" --json && step=$(figures grid_step) || return 0
    expect 0 "$name" compare "$mesh" full.ply --samples 20000 --json || return 0
    read -r diagonal max < <(figures diagonal max | paste -sd' ')
    holds "$name: full detail lies on the input" "$max <= 0.867 * $step + 1e-6 * $diagonal" # half a cell's diagonal
    error=$(awk "BEGIN {print 0.01 * $diagonal}")
    expect 0 "$name" extract "$mnt" --error "$error" -o part.ply --json || return 0
    got=$(figures triangles)
    holds "$name: an error takes triangles away" "$loose || $got < 0.9 * $triangles"
    [[ $got -gt 0 ]] || return 0
    expect 0 "$name" compare "$mesh" part.ply --samples 20000 --json || return 0
    holds "$name: within the error" "$(figures mean_ab) <= $error"
}

# line NAME MESH VERTICES TRIANGLES KEY=VALUE…: all of it. loose: an extract may fall short of its
# count, because one collapse can take many triangles.
line() {
    local name=$1 mesh=$2 vertices=$3 triangles=$4 policy pair
    shift 4
    built "$name packed" "$mesh" packed.mnt || return 0
    equal "$name" vertices "$vertices"
    equal "$name" triangles "$triangles"
    for pair in "$@"; do
        equal "$name" "${pair%=*}" "${pair#*=}"
    done
    built "$name levels" "$mesh" levels.mnt --blocking levels -L "$levels" --metric "$metric" || return 0
    expect 0 "$name" simplify "$mesh" -o tree.vdt --metric "$metric" --json &&
        check "$name: json" "$helpers/e2e_json" vertices collapses_by_stage <"$out"
    expect 0 "$name" block tree.vdt -o halves.mnt --blocking levels -L "$levels" --json &&
        check "$name: two halves are the whole" cmp halves.mnt levels.mnt
    for policy in packed.mnt levels.mnt tree.vdt; do
        expect 0 "$name $policy" info "$policy" --json && equal "$name $policy" triangles "$triangles"
        expect 0 "$name $policy" verify "$policy" --against "$mesh" --json &&
            equal "$name $policy" matched_triangles "$triangles"
    done
    extracted "$name" packed.mnt "$triangles"
    $flat || distances "$name" "$mesh" packed.mnt
}

# ---- made ones ----------------------------------------------------------------------------------

made() { # NAME …as line, without the file; what loose … metric say is the caller's
    shape "$1" >"$1.obj"
    line "$1" "$1.obj" "${@:2}"
}

made_models() {
    loose=0 flat=false levels=3 metric=length
    made torus 1800 3600 components=1 boundary_edges=0 nonmanifold_edges=0 misoriented_faces=0
    made pole 9002 18000 components=1 boundary_edges=0 nonmanifold_edges=0
    loose=1
    made components 600 800 components=100 boundary_edges=0 virtual_collapses=99
    made sheet 1681 3200 components=1 boundary_edges=160 nonmanifold_edges=0
    made fins 205 320 components=1 boundary_edges=168 nonmanifold_edges=40
    made lone 900 300 components=300 boundary_edges=900 virtual_collapses=299
    made twice 12 16 input_faces=32 duplicate_faces=16 components=2 boundary_edges=0
    made one 3 1 components=1 boundary_edges=3
    made bowtie 19 16 components=1 boundary_edges=20 nonmanifold_edges=0
    metric=qem # builds that recount everything take minutes with length
    made book 3002 3000 components=1 boundary_edges=6000 nonmanifold_edges=1
    made spine 1003 2000 components=1 boundary_edges=2000 nonmanifold_edges=2
    metric=length
    made moebius 180 240 components=1 boundary_edges=120
    made dirty 5 4 input_faces=7 duplicate_faces=1 degenerate_faces=1 nonfinite_faces=1 \
        welded_vertices=4 unused_vertices=2
    flat=true # nothing to spread samples on
    made flat 13 11 components=1 degenerate_faces=0

    loose=0 flat=false levels=5 metric=length
    expect 0 sponge make isosurface --triangles 20000 --seed 3 -o sponge.ply || return 0
    expect 0 sponge build sponge.ply -o packed.mnt --json || return 0
    local v t boundary components
    read -r v t boundary components < <(figures vertices triangles boundary_edges components | paste -sd' ')
    holds "sponge: many handles" "$boundary == 0 && $components - ($v - $t / 2) / 2 > 10"
    line sponge sponge.ply "$v" "$t" boundary_edges=0 nonmanifold_edges=0 misoriented_faces=0
}

# Faces that die in one collapse, more of them than a small block holds, go on in overflow blocks.
overflow() {
    expect 0 overflow build spine.obj -o spine.mnt --block-bytes 4096 || return 0
    expect 0 overflow info spine.mnt --json && holds "overflow" "$(figures overflow_max) >= 1"
    expect 0 overflow verify spine.mnt --against spine.obj || true
    expect 0 "without welding" build dirty.obj -o apart.mnt --weld off --json &&
        equal "without welding" welded_vertices 0
    expect 0 "without welding" verify apart.mnt --against dirty.obj --weld off || true
}

# The same tree for any cap and any -j, in less memory where the cap says so.
rounds() {
    expect 0 rounds make terrain --triangles 120k --seed 5 -o hills.ply || return 0
    expect 5 "rounds: no cap" build hills.ply -o never.mnt --ram 1M || return 0
    local least jobs most
    least=$(grep -o -- '--ram [0-9]*M' "$err" | grep -o '[0-9]*')
    built "rounds, 1G" hills.ply most.mnt --ram 1G || return 0
    most=$(figures rss_peak_bytes)
    for jobs in 1 2 3; do
        built "rounds, -j $jobs" hills.ply "rounds$jobs.mnt" --ram "${least}M" -j "$jobs" || return 0
        holds "rounds: more than one" "$(figures rounds) > 2"
        $sanitized || holds "rounds: less memory" "$(figures rss_peak_bytes) < $most"
        check "rounds: any -j" cmp "rounds$jobs.mnt" most.mnt
    done
    built "rounds, more memory" hills.ply more.mnt --ram "$((least + 4))M" || return 0
    check "rounds: any cap" cmp more.mnt most.mnt
    expect 0 rounds verify most.mnt --against hills.ply || true
    expect 1 "rounds: no place" build hills.ply -o never.mnt --ram "${least}M" --temp-dir nowhere &&
        one_line "rounds: no place" nowhere
    holds "rounds: nothing left behind" "$(find . -maxdepth 1 -name 'never*' | wc -l) == 0"
}

# verify must see what is not the input.
strangers() {
    expect 0 strangers build torus.obj -o torus.mnt || return 0
    expect 3 "another mesh" verify torus.mnt --against sheet.obj && one_line "another mesh" torus.mnt
    sed '100s/^f/f/; 2000s/^f \([0-9]*\) \([0-9]*\) /f \2 \1 /' torus.obj >turned.obj
    expect 3 "a face turned round" verify torus.mnt --against turned.obj && one_line "a face turned round"
    sed '7s/^v [^ ]*/v 9/' torus.obj >moved.obj
    expect 3 "a vertex moved" verify torus.mnt --against moved.obj && one_line "a vertex moved"
    sed '$d' torus.obj >fewer.obj
    expect 3 "a face less" verify torus.mnt --against fewer.obj && one_line "a face less"
}

# ---- real ones ----------------------------------------------------------------------------------

real_models() {
    loose=0 flat=false levels=5 metric=length
    if [[ ! -d $meshes ]]; then
        skip "real models: no folder $meshes (MN_MESHES names one)"
        return
    fi
    while read -r name vertices triangles counts; do
        if [[ ! -f $meshes/$name ]]; then
            skip "$name: not in $meshes"
            continue
        fi
        # shellcheck disable=SC2086
        line "$name" "$meshes/$name" "$vertices" "$triangles" $counts
    done <<'END'
teapot.obj 3241 6320 welded_vertices=403
fandisk.obj 6475 12946 boundary_edges=0 nonmanifold_edges=0
beetle-alt.obj 19885 38656 boundary_edges=1136 welded_vertices=2
bunny.obj 34834 69451 boundary_edges=223 unused_vertices=1113
armadillo.obj 43243 86482 boundary_edges=0 nonmanifold_edges=0
nefertiti.obj 49971 99938 boundary_edges=0
igea-tristrips.ply 134345 268686 boundary_edges=0
END
}

case $which in
made)
    part made_models
    part overflow
    part rounds
    part strangers
    ;;
real) part real_models ;;
*)
    echo "usage: e2e_meshes.sh [BUILD [real]]" >&2
    exit 2
    ;;
esac
finish
