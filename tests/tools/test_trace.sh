#!/bin/sh
# Goal: replay --trace and metanode trace as a user meets them: figures equal replay's own, JSON that
# viewers take with every flow joined, the same bytes for a seed, damage told in one line.
# Method: a made model in a folder of its own; usage: test_trace.sh METANODE E2E_JSON TRACE_DICE
set -u
metanode=$1
json=$2
dice=$3
. "$(dirname "$0")/lines_lib.sh"

# same KEY …: of replay.json and trace.json.
same() {
    for key in "$@"; do
        a=$("$json" "$key" <replay.json) || fail "replay has no $key"
        b=$("$json" "$key" <trace.json) || fail "trace has no $key"
        [ "$a" = "$b" ] || fail "$run: $key is $a in replay's figures and $b in the trace's"
    done
}

# sum COLUMN: of replay.csv.
sum() {
    awk -F, -v name="$1" 'NR == 1 { for (i = 1; i <= NF; i++) if ($i == name) c = i; next }
        { s += $c } END { print s + 0 }' replay.csv
}

expect 0 make terrain --triangles 60000 -o in.ply
expect 0 build in.ply -o a.mnt --block-bytes 4K

# --- figures: disks, prefetches, memories, with what comes before and after the run
while read -r run; do
    # shellcheck disable=SC2086
    expect 0 replay a.mnt --path dive --frames 60 --tolerance 2 $run --json --csv replay.csv --trace a.trace
    mv out.txt replay.json
    expect 0 trace a.trace --json
    mv out.txt trace.json
    # A machine too busy for the writer drops events, and says so: never with the simulated disk.
    if [ "$("$json" dropped <trace.json)" -gt 0 ]; then
        case $run in
        *sim*) fail "$run: events were dropped" ;;
        *) echo "skipped: $run: events were dropped" && continue ;;
        esac
    fi
    same frames misses miss_rate_mean miss_rate_overall refused_front refused_budget refused_pool \
        k commands_loaded commands_resident commands_given_up commands_failed reads second_chances \
        prefetches prefetches_given_up prefetches_loaded prefetches_used urgent_up urgent_down \
        urgent_down_refused evictions blocks_in_use_max blocks_with_ancestors_max store prefetch
    for key in splits collapses; do
        [ "$(sum $key)" = "$("$json" $key <trace.json)" ] || fail "$run: $key differ"
    done
    for key in levels_differ moves_differ; do
        [ "$("$json" $key <trace.json)" = 0 ] || fail "$run: $key is not 0"
    done
    [ "$("$json" reads <trace.json)" -gt 0 ] || fail "$run: nothing was read"
done <<'RUNS'
--io sim -K 60
--io sim -K min --prefetch neighbours --degrade off
--io sim -K 40 --prefetch off --settle --fps 0
--io sim -K 60 --barrier --open settled
--io pread -K 60 --open settled --fps 0
--io uring --ram 8M --settle --fps 0
RUNS

# --- with a budget every frame is as long as the others: it looks ahead all the same
for path in orbit dive; do # only frames shorter than usual ones did: 28 and 31 of 60, where 52 and 51 do
    expect 0 replay a.mnt --path $path --frames 60 --tolerance 2 --io sim -K 60 --nav-ops 40 --trace a.trace
    expect 0 trace a.trace --to csv -o a.csv
    looks=$(grep -c ',phase,foresight,' a.csv)
    [ "$looks" -ge 45 ] || fail "$path with a budget: $looks of 60 frames look ahead"
done

# --- the same bytes for a seed
for name in one other; do
    expect 0 replay a.mnt --path orbit --frames 40 --io sim --io-serial --seed 5 -K 50 --trace $name
done
cmp -s one other || fail "two runs of one seed have other traces"

# --- for viewers
flows() { # every t and f has an s before it, every s an f, and each a slice to stand on; no slice is left open
    awk -v RS='\n' '
        function field(name,  at) {
            at = index($0, "\"" name "\":")
            return at == 0 ? "" : substr($0, at + length(name) + 3) + 0
        }
        /"ph":"[stf]"/ && (field("ts") != stand || $0 !~ thread) { print "nothing to stand on: " $0 }
        /"ph":"X"/ { stand = field("dur") > 0 ? field("ts") : -1; thread = "\"tid\":" field("tid") "," }
        /"ph":"[tf]"/ && !/"bp":"e"/ { print "not bound to the slice around it: " $0 }
        /"ph":"s"/ { if (field("id") in open) print "a flow begins twice: " $0; open[field("id")] = 1; n++ }
        /"ph":"[tf]"/ { if (!(field("id") in open)) print "no s before: " $0 }
        /"ph":"f"/ { delete open[field("id")] }
        /"ph":"b"/ { if (reading[field("id")]++) print "read twice at once: " $0 }
        /"ph":"e"/ { if (--reading[field("id")]) print "read ends before it began: " $0 }
        /"ph":"B"/ { depth++ }
        /"ph":"E"/ { if (--depth < 0) print "a slice ends before it began: " $0 }
        END {
            for (id in open) print "no f for flow " id
            for (id in reading) if (reading[id]) print "a read does not end"
            if (depth) print "a slice does not end"
            if (!n) print "no flows"
        }' "$1"
}
expect 0 replay a.mnt --path dive --frames 60 --io pread --fps 0 -K 60 --trace a.trace
for window in "" "--from-frame 5" "--from-frame 5 --to-frame 20" "--to-frame 3"; do
    # shellcheck disable=SC2086
    expect 0 trace a.trace --to chrome $window -o a.json
    grep -q '"displayTimeUnit":"ns"' a.json || fail "chrome $window: microseconds, and slices in each other"
    "$json" --foreign displayTimeUnit <a.json >/dev/null || fail "chrome $window: no JSON"
    wrong=$(flows a.json)
    [ -z "$wrong" ] || fail "chrome $window: $wrong"
done
[ "$(grep -c '"ph":"B".*"name":"frame ' a.json)" -eq 4 ] || fail "--to-frame 3 is not four frames"
expect 0 trace a.trace --to csv --from-frame 7 --to-frame 9 -o a.csv
[ "$(grep -c ',frame_begin,' a.csv)" -eq 3 ] || fail "csv: not three frames"
[ "$(awk -F, 'NF != 6' a.csv | wc -l)" -eq 0 ] || fail "csv: rows of other than 6 columns"
expect 0 trace a.trace
grep -q '^misses  ' out.txt || fail "the report has no misses"
expect 0 trace a.trace --k 40,80 --json
"$json" reuse <out.txt | grep -q '"k": 80' || fail "--k is not heeded"

# --- without a pool: what the run says of it, and no reads, which are before or beside it
for store in mapped resident; do # K was that of the plan, and prefetch on
    expect 0 replay a.mnt --path dive --frames 20 --store $store --trace a.trace --json
    mv out.txt replay.json
    expect 0 trace a.trace --json
    mv out.txt trace.json
    same k store prefetch
    for key in k k_min reads read_bytes; do
        [ "$("$json" $key <trace.json)" = null ] || fail "$store: $key is not null"
    done
    expect 0 trace a.trace
    grep -q '^disk  ' out.txt && fail "$store: the report has a disk"
done
expect 0 trace a.trace --k 40,80,1000

# --- what cannot be read
expect 0 replay a.mnt --path orbit --frames 3 --io sim -K 60 --trace good
bytes=$(wc -c <good)
for length in 0 7 511 512 600 $((bytes / 2)) $((bytes - 1)); do
    head -c "$length" good >bad
    expect 3 trace bad
    says bad
done
says 'cut'
expect 0 trace bad --cut
grep -q 'ends before its end' out.txt || fail "a cut trace is not called one"
for at in 3 100 600 $((bytes - 5)); do
    { head -c "$at" good && printf '\377' && tail -c +$((at + 2)) good; } >bad
    expect 3 trace bad
    expect 3 trace bad --to chrome
    says bad
done
expect 3 trace in.ply
says 'not a trace'
expect 3 trace nowhere

# --- events that follow from nothing
for seed in $(seq "${MN_SEED:-1}" $((${MN_SEED:-1} + 9))); do
    "$dice" "$seed" a.trace || fail "no trace from seed $seed"
    expect 0 trace a.trace
    expect 0 trace a.trace --json
    "$json" frames <out.txt >/dev/null || fail "seed $seed: no JSON"
    expect 0 trace a.trace --to chrome -o a.json
    grep -q '"displayTimeUnit":"ns"' a.json || fail "chrome $window: microseconds, and slices in each other"
    "$json" --foreign displayTimeUnit <a.json >/dev/null || fail "seed $seed: no JSON for viewers"
    wrong=$(flows a.json | grep -v 'no flows')
    [ -z "$wrong" ] || fail "seed $seed: $wrong"
done

# --- usage
expect 2 trace
expect 2 trace good good
expect 2 trace good --to html
expect 2 trace good --from-frame 9 --to-frame 3
expect 2 trace good --from-frame 9
expect 2 trace good --to csv --json
expect 2 trace good --k 0
expect 2 trace good --k 8 --to csv # it had been passed over
expect 2 trace good --k 7,,8
expect 2 trace good -o good
expect 1 trace good -o nowhere/x
expect 2 replay a.mnt --path orbit --trace a.mnt
expect 2 shoot a.mnt --trace a.mnt -o x.png
expect 2 replay a.mnt --path orbit --trace x --csv x
if [ -c /dev/full ]; then
    expect 4 trace good --to csv -o /dev/full
    says /dev/full
fi

[ $failures -eq 0 ] && echo "all as it should be"
exit $((failures > 0))
