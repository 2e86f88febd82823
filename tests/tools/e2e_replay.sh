#!/usr/bin/env bash
# Goal: whatever the model, path, store and number of place holders, a navigation settles, comes back to
# the roots, counts right, allocates nothing, and can be repeated.
# Method: replay on made models; sums that must agree, figures of two runs, settled fronts of many. In a
# build with slow_checks every front passed through is recounted as well.
# e2e_replay.sh [BUILD]
source "$(dirname "$0")/e2e_lib.sh"
source "$(dirname "$0")/e2e_shapes.sh"
cd "$scratch"

# design.md §5, all of them, and front_hash.
replay_keys=(frames adapt_mean triangles_mean triangles_max front_over_wanted tolerance_px misses
    miss_rate_mean miss_rate_overall refused_front refused_budget refused_pool waits_dependency settle_frames
    back_at_roots commands commands_loaded commands_resident commands_given_up commands_failed nav_ms_mean
    nav_ms_p50 nav_ms_p99 nav_ms_max error_px_p50 error_px_p95 error_px_max error_inside_px_p50 error_inside_px_p95 error_inside_px_max reads read_bytes second_chances
    prefetches prefetches_given_up urgent_up urgent_down urgent_down_refused evictions k l block_bytes_max
    ram_cap_bytes ram_planned_bytes ram_min_bytes ram_base_bytes ram_front_bytes ram_pool_bytes ram_tables_bytes
    active_nodes_max front_max major_faults rss_peak_bytes gl_rss_bytes allocations_after_seal store
    checksum_failures io_errors start_reads start_seconds opening_frames opening_misses opening_reads opening_seconds nav_lock_waits nav_lock_wait_us_max io_lock_hold_us_max front_hash)

# build_model NAME: NAME-packed.mnt in blocks of 4 KiB, so that there are many, and NAME-levels.mnt.
build_model() {
    local mesh=$1.ply
    if [[ ! -f $mesh ]]; then
        mesh=$1.obj
        shape "$1" >"$mesh"
    fi
    expect 0 "$1" build "$mesh" -o "$1-packed.mnt" --block-bytes 4096 --metric "${2-qem}" &&
        expect 0 "$1" build "$mesh" -o "$1-levels.mnt" --blocking levels -L 3 --metric "${2-qem}"
}

# navigated NAME ARGUMENT…: replay with --settle, and what must hold of any.
navigated() {
    local name=$1 sum
    shift
    expect 0 "$name" replay "$@" --fps 0 --settle --json || return 1
    if [[ -s $err ]] && ! grep -q 'warning' "$err"; then
        fail "$name: it said something"
    fi
    check "$name: keys" "$helpers/e2e_json" "${replay_keys[@]}" <"$out"
    equal "$name" back_at_roots true
    equal "$name" allocations_after_seal 0
    equal "$name" checksum_failures 0
    equal "$name" io_errors 0
    sum=$(figures commands_loaded commands_resident commands_given_up commands_failed | paste -sd+)
    holds "$name: every command ends once" "$(figures commands) == $sum"
    holds "$name: settles" "$(figures settle_frames) < 100000"
    holds "$name: quantiles" "$(figures nav_ms_p50 nav_ms_p99 nav_ms_max | paste -sd' ' |
        awk '{print ($1 <= $2 && $2 <= $3)}')"
}

# ---- every model, path, store ---------------------------------------------------------------------

models=(torus components fins lone twice one flat bowtie moebius dirty sheet spine)
stores=("paged -K min" "paged -K 12" "paged --ram 16M" "mapped" "resident")

every_combination() {
    local model path kind store turn=0
    for model in "${models[@]}"; do
        build_model "$model" || continue
        for path in orbit dive flyover; do
            # each store with each path, blockings in turn
            for store in "${stores[@]}"; do
                turn=$((turn + 1))
                kind=packed
                [[ $((turn % 2)) -eq 0 ]] || kind=levels
                # shellcheck disable=SC2086
                navigated "$model-$kind $path $store" "$model-$kind.mnt" --path "$path" --frames 30 \
                    --store $store || true
            done
        done
    done
}

# ---- settled fronts ---------------------------------------------------------------------------------

# fronts NAME ARGUMENT…: the front after each frame, all of them settled, as NAME.fronts.
fronts() {
    local name=$1
    shift
    expect 0 "fronts of $name" replay "$@" --barrier --degrade off --fps 0 --frames 16 --csv "$name.csv" ||
        return 1
    awk -F, 'NR == 1 {for (i = 1; i <= NF; i++) if ($i == "front_hash") c = i; n = NF}
        NF != n || (NR > 1 && $c !~ /^[0-9a-f]+$/) {bad = 1} NR > 1 {print $c} END {exit bad || NR != 17}' \
        "$name.csv" >"$name.fronts" || fail "$name: not a row of equal columns a frame"
}

# One front a camera, whatever gives the blocks, however they are cut, and whichever way it was reached.
# settled_fronts MODEL WEIGHT…: under these options
settled_fronts() {
    local model=$1 path
    shift
    for path in orbit dive flyover; do
        fronts reference "$model-packed.mnt" --path "$path" --store resident "$@" || continue
        holds "$model $path: the front moves" "$(sort -u reference.fronts | wc -l) > 3"
        local -A run=([mapped]="$model-packed.mnt --store mapped" [levels]="$model-levels.mnt --store resident"
            [paged]="$model-packed.mnt --store paged" [pread]="$model-levels.mnt --io pread"
            [sim]="$model-packed.mnt --io sim --seed 3" [budget]="$model-packed.mnt --nav-ops 40"
            [serial]="$model-levels.mnt --io-serial")
        for name in "${!run[@]}"; do
            # shellcheck disable=SC2086
            fronts "$name" ${run[$name]} --path "$path" "$@" &&
                check "$model $path${*:+ }$*: $name has resident's fronts" cmp "$name.fronts" reference.fronts
        done
    done
}

# ---- a file system without O_DIRECT -------------------------------------------------------------------

# ramfs has none. One warning, the same fronts, and the cap.
without_o_direct() {
    local model=$1 io real=$metanode
    mkdir -p ram
    if ! unshare -rm mount -t ramfs none ram 2>"$err"; then
        skip "a file system without O_DIRECT ($(head -n 1 "$err"))"
        return
    fi
    cat >on-ram <<END
#!/bin/sh
exec unshare -rm sh -c 'mount -t ramfs none ram && cp $model-packed.mnt ram/ && exec "\$@"' - "$real" "\$@"
END
    chmod +x on-ram
    for path in orbit dive; do
        fronts reference "$model-packed.mnt" --path "$path" --store resident || continue
        for io in uring pread; do
            metanode=$scratch/on-ram
            fronts "ramfs-$io" "ram/$model-packed.mnt" --path "$path" --io "$io" &&
                holds "ramfs-$io: one warning" "$(grep -c 'warning: ram/.*O_DIRECT' "$err") == 1" &&
                check "$model $path: ramfs and $io have resident's fronts" cmp "ramfs-$io.fronts" reference.fronts
            metanode=$real
        done
    done
}

# ---- the same figures twice -------------------------------------------------------------------------

same_figures() {
    local model=$1 io
    for io in sim pread uring; do
        for run in first second; do
            expect 0 "repeat $io" replay "$model-packed.mnt" --path dive --frames 60 -K 12 --io "$io" --io-serial \
                --seed 7 --fps 0 --settle --json --csv "$run.csv" || return 0
            grep -vE '"(nav_ms|nav_cpu_ms|io_busy|io_depth|io_full|io_cpu|rss|gl_rss|nav_lock|io_lock|start_seconds|opening_seconds)' "$out" >"$run.json"
            awk -F, 'NR == 1 {for (i = 1; i <= NF; i++) if ($i == "nav_ms") c = i} {$c = ""; print}' "$run.csv" \
                >"$run.rows"
        done
        check "$io: the same figures twice" cmp first.json second.json
        check "$io: the same rows twice" cmp first.rows second.rows
    done
}

# ---- paths written out ------------------------------------------------------------------------------

# A standard path as a file, a key a frame, gives the same figures; a key every tenth frame, nearly the
# same triangles where everything is resident (a pool of few places makes much of a small step aside).
written_paths() {
    local file=$1 path every was
    local pool=(--io sim --io-serial -K 12 --fps 0 --settle --json) resident=(--store resident --json)
    local times='"(nav_ms|nav_cpu_ms|start_seconds|rss|gl_rss|nav_lock|io_lock|ram_)'
    for path in orbit dive flyover; do
        for every in 1 10; do
            expect 0 "$path written" replay "$file" --path "$path" --frames 61 --write-path "$path.$every.path" \
                --key-every "$every" || continue 2
        done
        expect 0 "$path" replay "$file" --path "$path" --frames 61 "${pool[@]}" || continue
        grep -vE "$times" "$out" >built-in.json
        expect 0 "$path read" replay "$file" --path "$path.1.path" "${pool[@]}" || continue
        grep -vE "$times" "$out" >recorded.json
        check "$path: the same figures" cmp built-in.json recorded.json

        expect 0 "$path, resident" replay "$file" --path "$path" --frames 61 "${resident[@]}" || continue
        was=$(figures triangles_mean)
        expect 0 "$path read, resident" replay "$file" --path "$path.10.path" "${resident[@]}" &&
            holds "$path: about the same triangles" "($(figures triangles_mean) / $was - 1) ^ 2 < 0.02 ^ 2"
    done
    expect 2 "no keys" replay "$file" --path orbit --write-path a.path --key-every 0 && one_line "no keys" key-every
    expect 2 "keys of nothing" replay "$file" --path orbit --frames 2 --key-every 4 && one_line "keys of nothing" write-path
    expect 2 "pictures of nothing" replay "$file" --path orbit --frames 2 --images-every 4 &&
        one_line "pictures of nothing" images
    expect 2 "over the path" replay "$file" --path dive.1.path --write-path dive.1.path
    expect 2 "over the model" replay "$file" --path dive --write-path "$file"
}

# ---- what is asked for is heeded --------------------------------------------------------------------

options() {
    local file=$1 coarse fine smallest weight i
    expect 0 "fine" replay "$file" --path orbit --frames 5 --store resident --barrier --tolerance 0.25 --json &&
        fine=$(figures triangles_mean)
    expect 0 "coarse" replay "$file" --path orbit --frames 5 --store resident --barrier --tolerance 8 --json &&
        coarse=$(figures triangles_mean)
    holds "a smaller tolerance gives more triangles" "$coarse < 0.7 * $fine"
    triangles=()
    for weight in "" "--frustum off" "--cones off" "--silhouettes on" "--light 1,1,1"; do
        # shellcheck disable=SC2086
        expect 0 "weights: $weight" replay "$file" --path flyover --frames 9 --store resident --json $weight &&
            triangles+=("$(figures triangles_mean)")
    done
    for i in 1 2 3 4; do
        holds "weight $i: more triangles than with the defaults" "${triangles[$i]} > ${triangles[0]}"
    done
    for weight in "--store resident" "-K min" "--io sim --nav-ops 100"; do
        # shellcheck disable=SC2086
        expect 0 "target: $weight" replay "$file" --path dive --frames 30 --triangles-max 1500 --fps 0 --json $weight &&
            holds "target: $weight: never more" "$(figures triangles_max) <= 1500"
        [[ $weight != "-K min" ]] || continue
        # shellcheck disable=SC2086
        expect 0 "target, settled: $weight" replay "$file" --path dive --frames 9 --triangles-max 1500 --barrier \
            --fps 0 --json $weight && holds "target: $weight: reached" "$(figures triangles_mean) > 1350"
    done
    expect 0 "frames" replay "$file" --path flyover --frames 7 --fps 0 --json && equal frames frames 7
    expect 0 "from the roots" replay "$file" --path orbit --frames 9 --fps 0 --open roots --prefetch off --io-serial --json &&
        equal "from the roots" opening_frames 0 && holds "from the roots: misses" "$(figures misses) > 0"
    expect 0 "settled" replay "$file" --path orbit --frames 9 --fps 0 --open settled --prefetch off --io-serial --json --csv settled.csv &&
        holds "settled: before the first frame" "$(figures opening_frames opening_misses opening_reads |
            paste -sd' ' | awk '{print ($1 > 1 && $2 > 0 && $3 > 0)}')" &&
        holds "settled: nothing is left to do" "$(awk -F, 'NR == 2 {print $1 + $2}' settled.csv) == 0"
    expect 0 "one frame" replay "$file" --path dive --frames 1 --fps 0 --json && equal "one frame" frames 1
    expect 0 "budget" replay "$file" --path orbit --frames 10 --fps 0 --nav-ops 5 --json --csv budget.csv &&
        holds "budget: adapt" "$(awk -F, 'NR > 1 && $2 > m {m = $2} END {print m + 0}' budget.csv) <= 40"
    printf 'metanode path 1\n0 0 9 0 0 0 0 1 0\n# on a line\n\n0 0 3 0 0 0 0 1 0 60\n' >cameras.path
    expect 0 "path file" replay "$file" --path cameras.path --fps 0 --json && equal "path file" frames 2
    expect 0 "text" replay "$file" --path orbit --frames 3 --fps 0 && check "text" grep -q 'frames' "$out" &&
        holds "text: the plan comes first" "$(grep -n '^plan .* base .* front .* pool .* tables' "$out" | cut -d: -f1) == 1"

    expect 5 "cap too small" replay "$file" --path orbit --ram 600K -K min && one_line "cap too small" --ram
    smallest=$(grep -oE '[0-9.]+[KMG]?i?B? ?' "$err" | tail -1 | tr -d ' ')
    expect 0 "the smallest cap ($smallest)" replay "$file" --path orbit --ram "$smallest" -K min --frames 10 --fps 0 \
        --settle --json && equal "the smallest cap" back_at_roots true
    expect 5 "K does not fit" replay "$file" --path orbit --ram 4M -K 100000 && one_line "K does not fit" --ram
}

# What bench adapt counts must agree with itself: over whole laps of one cycle as much is made as removed.
adapt_bench() {
    local file=$1
    expect 0 "bench adapt" bench adapt "$file" --path orbit --frames 8 --slow-frames 20 --json || return 0
    check "bench adapt: keys" "$helpers/e2e_json" fast_frames slow_frames files <"$out"
    check "bench adapt: no figure is missing" test "$(grep -oE '"triangles_(made|removed)": [1-9]' "$out" | wc -l)" -ge 3
    check "bench adapt: laps close" test "$(grep -o '"triangles_made": [0-9]*' "$out" | head -1 | grep -o '[0-9]*$')" \
        -eq "$(grep -o '"triangles_removed": [0-9]*' "$out" | head -1 | grep -o '[0-9]*$')"
    expect 0 "bench adapt as a table" bench adapt "$file" --frames 4 --slow-frames 5 --front 300 &&
        check "bench adapt as a table: three paths" grep -q flyover "$out"
    expect 2 "bench adapt of nothing" bench adapt && one_line "bench adapt of nothing" FILE
}

part every_combination
expect 0 hills make terrain --triangles 6000 --seed 5 -o hills.ply || finish
build_model hills || finish
part settled_fronts torus
part settled_fronts hills
part settled_fronts torus --frustum 3 --cones off --silhouettes 4 --light on --light-factor 3
part without_o_direct hills
part same_figures hills
part written_paths hills-packed.mnt
part options hills-packed.mnt
part adapt_bench hills-packed.mnt
finish
