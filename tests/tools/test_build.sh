#!/bin/sh
# Goal: build, simplify, block, info, verify and extract as a user meets them: figures, exit codes,
# one line for each error (e2e_outputs.sh has what stands in the way of outputs).
# Method: a made model in a folder of its own; usage: test_build.sh METANODE
set -u
metanode=$1
. "$(dirname "$0")/lines_lib.sh"

expect 0 make sphere --triangles 3000 -o in.ply

# --- the main way, both halves, both policies
expect 0 build in.ply -o a.mnt --json
for key in vertices triangles input_faces duplicate_faces degenerate_faces nonfinite_faces \
    misoriented_faces unused_vertices welded_vertices merged_positions nonmanifold_edges \
    boundary_edges components roots nodes hinges collapses_by_stage virtual_collapses legal_last \
    depth_max block_depth blocks fill_mean order_violations order_violation_worst \
    order_violation_bound order_unknown rounds collapses_per_second \
    seconds_read seconds_simplify seconds_order seconds_block bytes_read bytes_written file_bytes \
    cpu_seconds_read cpu_seconds_simplify cpu_seconds_order cpu_seconds_block \
    bytes_read_read bytes_read_simplify bytes_read_order bytes_read_block bytes_written_read \
    bytes_written_simplify bytes_written_order bytes_written_block temp_bytes_planned temp_bytes_peak \
    bytes_per_vertex ram_cap_bytes rss_peak_bytes l block_bytes metric blocking; do
    [ "$(grep -c "^  \"$key\": " out.txt)" -eq 1 ] || fail "build --json: key $key"
done
expect 0 simplify in.ply -o a.vdt
expect 0 block a.vdt -o b.mnt
cmp -s a.mnt b.mnt || fail "build and simplify + block differ"
expect 0 block a.mnt -o b.mnt
cmp -s a.mnt b.mnt || fail "a .mnt blocked again differs"
for options in "--blocking levels -L 3" "--block-bytes 4K" "--block-bytes 64K"; do
    # shellcheck disable=SC2086 # options are words
    expect 0 block a.vdt -o c.mnt $options
    expect 0 verify c.mnt --against in.ply
done
# --- at once, in memory: a tree of the same mesh, made without a cap, files or cells
expect 0 simplify in.ply -o once.vdt --at-once --json
for line in '"rounds": 1' '"ram_cap_bytes": null'; do
    grep -q "$line" out.txt || fail "simplify --at-once: $line: $(cat out.txt)"
done
expect 0 verify once.vdt --against in.ply
for option in "--ram 64M" "--work-ram 4M" --resume; do
    # shellcheck disable=SC2086
    expect 2 simplify in.ply -o z.vdt --at-once $option
    says '--at-once has no'
done
expect 2 build in.ply -o z.mnt --at-once
# --- compressed: the same tree, in fewer bytes, the same ones each time
for options in "" "--blocking levels -L 3" "--block-bytes 64K"; do
    # shellcheck disable=SC2086 # options are words
    expect 0 block a.vdt -o c.mnt $options
    # shellcheck disable=SC2086
    expect 0 build in.ply -o z.mnt --zstd $options --ram 16M
    # shellcheck disable=SC2086
    expect 0 block a.vdt -o y.mnt --zstd=3 $options -j 2
    cmp -s z.mnt y.mnt || fail "$options: compressed by build and by block differ"
    expect 0 verify z.mnt --against in.ply
    expect 0 extract c.mnt --error 0.01 -o x.ply
    expect 0 extract z.mnt --error 0.01 -o y.ply
    cmp -s x.ply y.ply || fail "$options: the compressed file's mesh is another"
    # shellcheck disable=SC2086
    expect 0 block z.mnt -o y.mnt $options
    cmp -s c.mnt y.mnt || fail "$options: unpacked again it is another"
    [ "$(wc -c <z.mnt)" -le "$(($(wc -c <c.mnt) + 4096))" ] || # the table takes a page
        fail "$options: compressed takes more"
    for store in "paged -K min --io pread" "paged -K min" "resident"; do
        # shellcheck disable=SC2086
        expect 0 replay z.mnt --path orbit --frames 5 --settle --barrier --json --store $store
        grep -q '"back_at_roots": true' out.txt || fail "$options $store: not back at the roots"
        grep -q '"allocations_after_seal": 0' out.txt || fail "$options $store: it allocates"
    done
    expect 2 replay z.mnt --path orbit --frames 5 --store mapped
    says 'without --zstd'
done
expect 0 info z.mnt
grep -q 'compressed, zstd level 3: ' out.txt || fail "info of a compressed file: $(cat out.txt)"
expect 0 info z.mnt --json
grep -q '"zstd_level": 3' out.txt || fail "info --json of a compressed file: $(cat out.txt)"
for level in 0 23 x; do
    expect 2 block a.vdt -o z.mnt --zstd=$level
    says '1 … 22'
done
# what cannot fit is said before more than the header is read, let alone simplified
# (spoilt: the last face has a corner that is no vertex, so who has read it says exit 3)
spoil() {
    { head -c -4 "$1" && printf '\377\377\377\377'; } >cut.ply
}
spoil in.ply
expect 5 build cut.ply -o z.mnt --ram 16M --zstd=22 --block-bytes 1M
says 'cut.ply: .*zstd.*need --ram 2[0-9]M'
expect 3 build cut.ply -o z.mnt --ram 16M --zstd=1 --block-bytes 64K
expect 5 block a.vdt -o z.mnt --ram 16M --zstd=22 --block-bytes 1M
says 'a.vdt: '
expect 0 verify a.vdt --against in.ply --json
# what a build that was killed has left for its --resume is nobody else's to clear
ln -s elsewhere/a.mnt-0.work a.mnt.work
expect 0 verify a.mnt --against in.ply
[ -L a.mnt.work ] || fail "verify removed the link of a build that may be gone on with"
rm -f a.mnt.work
expect 0 verify a.vdt
grep -q '^a.vdt: sound: [0-9]* nodes' out.txt || fail "verify of a .vdt: $(cat out.txt)"
# --- the grid: coarser is smaller, what falls together is counted, on both sides alike
before=0
for bits in 8 12 16 23; do
    expect 0 build in.ply -o grid.mnt --position-bits $bits --block-bytes 4K --json
    merged=$(sed -n 's/^  "merged_positions": \([0-9]*\).*/\1/p' out.txt)
    expect 0 verify grid.mnt --against in.ply --json
    grep -q "\"merged_positions\": $merged" out.txt || fail "not $merged merged: $(cat out.txt)"
    bytes=$(wc -c <grid.mnt)
    [ "$bytes" -ge "$before" ] || fail "$bits bits take less than fewer"
    before=$bytes
done
cmp -s a.mnt grid.mnt && fail "23 bits a position are as 16"
for bits in 7 24 x; do
    expect 2 build in.ply -o grid.mnt --position-bits $bits
    says "8 … 23"
done
expect 0 make sphere --triangles 100000 -o many.ply
expect 0 build many.ply -o grid.mnt --position-bits 8 --json
grep -q '"merged_positions": 0' out.txt && fail "nothing falls together on 256 steps"
expect 0 verify grid.mnt --against many.ply
rm many.ply grid.mnt
expect 0 build in.ply -o d.mnt --weld off --metric length -j 2 --ram 64M
expect 0 verify d.mnt --against in.ply
expect 0 info a.mnt --json
expect 0 info a.vdt
expect 0 extract a.mnt --full -o full.ply
expect 0 verify a.mnt --against full.ply
expect 0 extract a.vdt --triangles 500 -o x.ply --json
grep -q '"triangles": \(500\|49[0-9]\),' out.txt || fail "extract --triangles 500: $(cat out.txt)"
expect 0 extract a.mnt --error 0.05 -o x.ply
expect 0 extract a.vdt --error 0.05 -o y.ply --temp-dir .
cmp x.ply y.ply || fail "extract --error: not the same of both files"
expect 1 extract a.mnt --error 0.05 -o x.ply --temp-dir nowhere
says nowhere

# --- what does not fit a cap is refused with what would, and that does
for command in "verify a.mnt" "verify a.vdt" "verify a.mnt --against in.ply" "extract a.mnt --full -o x.ply" \
    "extract a.mnt --error 0.01 -o x.ply" "block a.mnt -o x.mnt"; do
    # shellcheck disable=SC2086 # words
    expect 5 $command --ram 1M
    says "try --ram"
    ram=$(sed -n 's/.*try --ram \([0-9]*M\).*/\1/p' err.txt)
    expect 0 $command --ram "$ram"
    rm -f x.ply x.mnt
done

# --- wrong usage
expect 2 build in.ply
expect 2 build -o x.mnt
expect 2 build in.ply more.ply -o x.mnt
expect 2 build in.ply -o x.mnt --nonsense
expect 2 build in.ply -o x.mnt --blocking levels -L 17
expect 2 build in.ply -o x.mnt -L 5
expect 2 build in.ply -o x.mnt --blocking levels --block-bytes 16K
expect 2 build in.ply -o x.mnt --block-bytes 5000
expect 2 build in.ply -o x.mnt --block-bytes 2M
expect 2 build in.ply -o x.mnt --ram much
expect 2 block a.vdt -o x.mnt --metric qem
expect 2 block a.vdt -o x.mnt --resume
expect 2 build in.ply -o x.mnt -j 0
expect 2 extract a.mnt -o x.ply
expect 2 extract a.mnt --full --error 1 -o x.ply
expect 2 extract a.mnt --error -1 -o x.ply
expect 2 verify
expect 2 build in.ply -o ""
says 'option -o needs a value'
expect 2 build in.ply --output=
says 'option --output= needs a value'
expect 2 view a.mnt --json
for command in build simplify block info verify extract; do
    expect 0 $command --help
done

# --- bad input
expect 3 build absent.ply -o x.mnt
expect 3 build . -o x.mnt
expect 3 verify in.ply
expect 3 info in.ply
expect 3 block in.ply -o x.mnt
expect 3 verify a.mnt --against a.mnt
expect 0 make sphere --triangles 3000 --seed 2 -o other.ply
expect 3 verify a.mnt --against other.ply
for bytes in 5000 8192; do # within a block, and after one
    head -c $bytes a.mnt >cut.mnt
    expect 3 info cut.mnt
    says "cut off: it has $bytes bytes, file_bytes is $(wc -c <a.mnt); copy it whole, or build"
done
{ cat a.mnt && echo; } >long.mnt
expect 3 info long.mnt
says "file_bytes is $(wc -c <a.mnt), the file has $(wc -c <long.mnt); copy it again"
rm long.mnt
: >cut.mnt
expect 3 replay cut.mnt --path orbit
says 'ends after 0 bytes of 4096; copy it whole, or make one with metanode build'
expect 3 replay a.vdt --path orbit
says 'is a .vdt, not a .mnt yet: .*metanode block'
for bytes in 100 5000; do # within the header, and after it
    head -c $bytes a.vdt >cut.vdt
    expect 3 block cut.vdt -o x.mnt
    says "after $bytes of [0-9]* bytes; copy it whole, or simplify again\|cut off: it has $bytes bytes, file_bytes is $(wc -c <a.vdt); copy it whole, or simplify again"
done
cp a.mnt torn.mnt
printf 'x' | dd of=torn.mnt bs=1 seek=$(($(wc -c <a.mnt) - 6000)) conv=notrunc 2>dd.txt
expect 0 info torn.mnt # the header alone is read
for command in "verify torn.mnt" "extract torn.mnt --full -o x.ply" "block torn.mnt -o x.mnt"; do
    # shellcheck disable=SC2086 # a command and its words
    expect 3 $command
    says checksum
done
[ -e x.mnt ] && fail "a failed command left a file"

# --- caps
expect 5 build in.ply -o x.mnt --ram 200K
ram=$(sed -n 's/.*try --ram \([0-9]*M\).*/\1/p' err.txt)
[ -n "$ram" ] || fail "exit 5 names no number: $(cat err.txt)"
expect 0 build in.ply -o x.mnt --ram "$ram"
expect 5 build in.ply -o x.mnt --ram $((${ram%M} - 1))M # what it names is the least
rm x.mnt

# blocks take memory too: the cap holds or it is refused before the mesh is read, with one that holds
rss() {
    sed -n 's/^  "rss_peak_bytes": \([0-9]*\).*/\1/p' out.txt
}
expect 0 make sphere --triangles 40000 -o planet.ply
expect 0 simplify planet.ply -o planet.vdt --ram 64M
spoil planet.ply
sanitized=false # a sanitizer takes memory of its own: no limits then
! nm -D "$metanode" 2>/dev/null | grep -qE '__(asan|tsan)_init' || sanitized=true
for options in "--blocking levels -L 16" "--block-bytes 256K"; do
    for command in "build cut.ply" "block planet.vdt"; do
        # shellcheck disable=SC2086 # words
        expect 5 $command -o x.mnt --ram 5M $options
        says "^metanode: ${command#* }: "
        ram=$(sed -n 's/.*try --ram \([0-9]*\)M.*/\1/p' err.txt)
        [ -n "$ram" ] || fail "$command $options: no number: $(cat err.txt)"
        for threads in 1 2; do
            # shellcheck disable=SC2086
            expect 0 ${command%% *} planet.${command##*.} -o x.mnt --ram "${ram}M" -j $threads --json $options
            $sanitized || [ "$(rss)" -le $((ram << 20)) ] || fail "$command $options: $(rss) bytes under ${ram}M"
        done
    done
done
rm planet.* x.mnt

# --- standard output on a full disk, and none at all
for command in "info a.mnt --json" "verify a.mnt" "extract a.mnt --full -o x.ply --json" "--help" \
    "replay a.mnt --path orbit --frames 2 --fps 0 --json" "compare in.ply in.ply --samples 10"; do
    # shellcheck disable=SC2086 # a command and its words
    "$metanode" $command >/dev/full 2>err.txt
    code=$?
    [ $code -eq 4 ] || fail "$command to a full disk: exit $code"
    says 'standard output'
    # shellcheck disable=SC2086
    "$metanode" $command >&- 2>err.txt
    code=$?
    [ $code -eq 1 ] || fail "$command without standard output: exit $code"
done
# no file of ours takes the place of a closed one, and our words with it
"$metanode" replay torn.mnt --path dive --tolerance 0.1 --frames 3 --barrier --trace t.csv >out.txt 2>&-
code=$?
[ $code -eq 0 ] || fail "replay without standard error: exit $code"
grep -q metanode t.csv && fail "what should be an error is in the trace: $(grep metanode t.csv)"
"$metanode" replay torn.mnt --path dive --tolerance 0.1 --frames 3 --barrier >out.txt 2>err.txt
says 'metanode: warning: torn.mnt'
"$metanode" make sphere --triangles 3000 -o x.ply >&- 2>err.txt || fail "make prints nothing: $(cat err.txt)"

left=$(find . -name '*.mnt*' ! -name '?.mnt' ! -name 'cut.mnt' ! -name 'torn.mnt')
[ -z "$left" ] || fail "left behind: $left"
[ $failures -eq 0 ] && echo "all good"
exit $((failures > 0))
