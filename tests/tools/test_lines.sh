#!/bin/sh
# Goal: what commands say to who asks for too much, too little or the wrong thing, or gives a damaged
# file: the fault itself, and the exit code that goes with it.
# Method: a made model in a folder of its own; usage: test_lines.sh METANODE
set -u
metanode=$1
. "$(dirname "$0")/lines_lib.sh"

expect 0 make sphere --triangles 6000 -o in.ply
expect 0 build in.ply --block-bytes 4K -o a.mnt
expect 0 block a.mnt --zstd -o z.mnt

# --- caps and place holders
expect 0 replay a.mnt --path orbit --frames 2 --fps 0 --store resident
[ -s err.txt ] && fail "resident without a cap: $(cat err.txt)"
for size in 16M 16MB 16MiB 16mb 0.015625G; do
    expect 0 replay a.mnt --path orbit --frames 2 --fps 0 --store resident --ram $size
    says 'warning: .*has the whole file in memory.*beside the cap of 16.0'
    grep -q ' MB of 16.00' out.txt || fail "--ram $size is another: $(head -n 1 out.txt)"
done
for size in 16Mi 16MBB 16BB 16BiB 16Q; do
    expect 2 replay a.mnt --path orbit --ram $size
    says "'$size'.*16M or 1.5G"
done
expect 5 replay a.mnt --path orbit --ram 1
says 'ram 1 is too small.* would work'
expect 5 replay a.mnt --path orbit --ram 2M
says 'ram 2048K is too small'
expect 2 replay a.mnt --path orbit -K 1000000000
says 'too many place holders'
expect 2 replay a.mnt --path orbit -K 1
says 'at least [0-9]* place holders; try -K min'
expect 2 replay z.mnt --path orbit --store mapped --ram 1M
says 'compressed.*another --store'

# --- shapes
expect 2 make foo
says "no shape 'foo'"
expect 2 make sphere
says 'where to'

# --- a file with a bit turned over in its last block
cp a.mnt bad.mnt
bytes=$(wc -c <bad.mnt)
at=$((bytes - 4096 + 300))
byte=$(od -An -tu1 -j $at -N 1 bad.mnt)
# shellcheck disable=SC2059 # an octal escape is made here
printf "\\$(printf %o $((byte ^ 1)))" | dd of=bad.mnt bs=1 seek=$at conv=notrunc 2>/dev/null
expect 3 verify bad.mnt
expect 3 stress bad.mnt --io pread --runs 4 --frames 60
says 'damaged.*verify'
expect 0 stress a.mnt --io pread --runs 2 --frames 20

# --- one kind of file for another, and half of one
expect 0 simplify in.ply -o a.vdt
expect 3 build a.mnt -o x.mnt
says 'a.mnt: is a .mnt, which is built already'
expect 3 build a.vdt -o x.mnt
says 'a.vdt: is a .vdt, which is simplified already: metanode block'
expect 3 replay a.vdt --path orbit
says 'metanode block a.vdt -o'
head -c 5000 in.ply >cut.ply
expect 3 build cut.ply -o x.mnt
says 'are left in the file; it is cut off'
head -c 60000 in.ply >cut.ply
expect 3 build cut.ply -o x.mnt
says 'it is cut off'

# --- what is no mesh, and no tree, is called what it is
printf 'ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n%s' \
    'element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
' >one.ply
expect 0 build one.ply -o one.mnt
grep -q ' 3 vertices, 1 triangle, 1 hinge, ' out.txt || fail "one of each: $(cat out.txt)"
for file in one.ply in.ply; do # shorter than a header, and longer
    expect 3 info $file
    says 'magic is not that of a .mnt; make one with metanode build'
done
expect 0 simplify one.ply -o one.vdt
[ "$(wc -c <one.vdt)" -lt 4096 ] || fail "one.vdt is not short"
expect 3 replay one.vdt --path orbit
says 'metanode block one.vdt -o'
gzip -c in.ply >packed.ply
expect 3 build packed.ply -o x.mnt
says 'packed.ply: is compressed (gzip): unpack it first'
{ printf '\211PNG\r\n\032\n\000\000\000' && head -c 3000 /dev/zero | tr '\000' '\377'; } >other.png
expect 3 build other.png -o x.mnt
says 'OBJ, OFF and OM are$'

# --- help fits a terminal; counts are taken as it says; names may be any bytes
for command in build simplify block info verify extract make compare replay view shoot stress trace \
    tune "bench adapt" "bench draw" "bench error" "bench simplify"; do
    # shellcheck disable=SC2086 # a command and its name
    expect 0 $command --help
    LC_ALL=C.UTF-8 awk -v name="$command" 'length($0) > 100 { print "FAILED: " name ": " $0; wide = 1 }
        END { exit wide }' out.txt || failures=$((failures + 1))
done
expect 0 view --help
grep -q -- --json out.txt && fail "view --help promises --json, which view refuses"
for command in replay shoot; do
    expect 0 $command --help
    grep -q '^  --json ' out.txt || fail "$command --help lacks --json"
done
expect 0 help
grep -q '^usage: metanode COMMAND' out.txt || fail "help: $(cat out.txt)"
expect 0 help build
grep -q '^usage: metanode build' out.txt || fail "help build: $(cat out.txt)"
expect 2 help frobnicate
for count in 2000 2k 2K; do
    expect 0 extract a.mnt --triangles $count -o x.ply
    grep -q ' 2000 triangles$' out.txt || fail "--triangles $count: $(cat out.txt)"
done
expect 0 extract a.mnt --triangles 1 -o x.ply
says 'warning: x.ply has no triangle.*--triangles'
bytes=$(printf 'b\344d \342\202\254 \355\240\200.ply') # Latin-1, a euro, half a surrogate pair
cp one.ply "$bytes"
expect 0 bench error "$bytes" --json --samples 100
iconv -f UTF-8 -t UTF-8 out.txt >/dev/null 2>&1 || fail "--json is no UTF-8"
grep -aq '"file": "b\\ufffdd € \\ufffd\\ufffd\\ufffd.ply"' out.txt || fail "--json: $(grep -a file out.txt)"
for output in "make sphere -o -" "extract a.mnt --full -o -" "build in.ply -o -" "shoot a.mnt -o -" \
    "replay a.mnt --path orbit --csv -" "replay a.mnt --path orbit --trace -"; do
    # shellcheck disable=SC2086 # a command and its words
    expect 2 $output
    says ': - is no output: name a file'
done
[ -e ./- ] && fail "a file named -"
while read -r kind output; do # a name that promises another kind of file than is written
    # shellcheck disable=SC2086
    expect 2 $output -o "out.$kind"
    says "out.$kind: it writes \.[a-z]*, not \.$kind; give it a name that ends so"
    [ -e "out.$kind" ] && fail "a file named out.$kind"
done <<'END'
stl make sphere
obj make sphere
mnt extract a.mnt --full
vdt build one.ply
mnt simplify one.ply
ply block a.mnt
jpg shoot a.mnt
END
expect 0 make sphere --triangles 100 -o out.PLY
expect 0 make sphere --triangles 100 -o out.mesh

# --- a trace, from a frame that it has not, and to standard output
expect 0 replay a.mnt --path orbit --frames 6 --fps 0 --io sim --trace t.trace
expect 2 trace t.trace --to csv --from-frame 7 -o t.csv
says 'from-frame 7: t.trace has 6 frames'
[ -e t.csv ] && fail "a table of no frames is there"
expect 2 trace t.trace --to chrome --from-frame 6
expect 0 trace t.trace --to csv --from-frame 5 -o -
grep -q ',frame_begin,\|,frame' out.txt || fail "no rows on standard output: $(head -n 2 out.txt)"
[ -e ./- ] && fail "a file named -"

# --- two options that name one output, whether it is there yet or not; folders that are not there
for trial in new there; do
    expect 2 replay a.mnt --path orbit --frames 2 --fps 0 --csv one --trace ./one
    says 'replay: --csv and --trace are one file'
    expect 2 shoot a.mnt --trace "$PWD/one" -o one
    says 'shoot: -o and --trace are one file'
    [ $trial = there ] || echo old >one
done
[ "$(cat one)" = old ] || fail "an output that two options name was written"
for option in --csv --trace --write-path; do
    expect 1 replay a.mnt --path orbit --frames 2 --fps 0 $option no/such
    says 'no/such: cannot be written: .*name a file in a directory that is there'
done
expect 1 replay a.mnt --path orbit --frames 2 --fps 0 --images in.ply --size 32x32
says 'images in.ply: is a file; name a directory'
expect 1 replay a.mnt --path orbit --frames 2 --fps 0 --images no/such
says 'no/such: cannot be made: .*name a directory in one that is there'

# --- an error is one line whatever a file is called, and names a --help that is there
expect 3 info "two
lines.mnt"
says 'two?lines.mnt: cannot open'
for bench in adapt draw error simplify; do
    expect 2 bench $bench --nonsense
    says "bench $bench: unknown option --nonsense; see metanode bench $bench --help"
done

# --- outputs stand there whole, or as they were
echo old >t.csv
expect 0 replay a.mnt --path orbit --frames 6 --fps 0 --csv t.csv
[ "$(wc -l <t.csv)" -eq 7 ] || fail "--csv: $(wc -l <t.csv) lines"
echo old >t.csv
"$metanode" replay a.mnt --path orbit --frames 600 --csv t.csv >out.txt 2>err.txt &
child=$!
sleep 0.5
kill -TERM $child
wait $child && fail "it was not interrupted"
[ "$(cat t.csv)" = old ] || fail "an interrupted replay leaves half of --csv"
expect 0 replay a.mnt --path orbit --frames 3 --write-path t.path
[ "$(wc -l <t.path)" -eq 5 ] || fail "--write-path: $(cat t.path)"
expect 0 trace t.trace --to csv -o /dev/stdout
[ "$(wc -l <out.txt)" -gt 6 ] || fail "-o /dev/stdout: $(cat out.txt)"
[ -z "$(find . -name '*.tmp')" ] || fail "left behind: $(find . -name '*.tmp')"

# --- who has several files is told of a missing one before the first is measured
for bench in adapt draw error; do
    file=a.mnt
    [ $bench = error ] && file=in.ply
    expect 3 bench $bench $file missing
    says 'missing: cannot .*open'
    [ ! -s out.txt ] || fail "bench $bench has begun: $(head -n 2 out.txt)"
done

# --- benches: an option's value is blamed on the option, before anything is printed; damage is told
for wrong in "adapt --frames 0" "adapt --slow-frames x" "adapt --front 0" "adapt --tolerance 0" \
    "simplify --globe 7" "simplify --runs 100" "simplify --samples x" "simplify --metric x"; do
    # shellcheck disable=SC2086 # a bench and its words
    expect 2 bench $wrong a.mnt
    given=${wrong#* }
    says "^metanode: bench ${wrong%% *}: ${given% *} '${given#* }' is not "
    [ ! -s out.txt ] || fail "bench $wrong has begun: $(head -n 2 out.txt)"
done
expect 2 bench adapt a.mnt --front 100 --tolerance 2
says 'bench adapt: --front .*--tolerance .*one of them'
expect 2 bench adapt a.mnt --path nosuch
says 'nosuch'
[ ! -s out.txt ] || fail "bench adapt has begun: $(head -n 2 out.txt)"
for option in "--path orbit" "--store paged"; do
    # shellcheck disable=SC2086 # an option and its value
    expect 2 bench draw a.mnt $option
    says "bench draw: no ${option% *} here: orbit and dive are flown, resident"
done
"$metanode" bench adapt bad.mnt --path orbit --frames 2 --slow-frames 2 --tolerance 8 >out.txt 2>err.txt ||
    fail "bench adapt of a damaged file: $(cat err.txt)"
says 'warning: bad.mnt: block [0-9]*: '

# --- a disk that is full when all has been opened, and directories that take no files
expect 0 replay a.mnt --path orbit --frames 6 --fps 0 --io sim --trace t.trace
for output in "replay a.mnt --path orbit --frames 400 --fps 0 --store resident --csv" \
    "replay a.mnt --path orbit --frames 4 --write-path" "trace t.trace --to csv -o"; do
    # shellcheck disable=SC2086 # a command and its words
    expect 4 $output /dev/full
    says 'No space left on device; make room, or write to another disk'
done
"$metanode" info a.mnt >/dev/full 2>err.txt && fail "a full disk is no error"
says 'standard output could not .*No space left on device; make room'
for command in "build in.ply" "simplify in.ply" "shoot a.mnt"; do
    # shellcheck disable=SC2086 # a command and its words
    expect 1 $command -o /proc/x
    says '/proc/x: cannot create: .*name a directory that is there, can be written and has room'
done
expect 1 build in.ply -o x.mnt --temp-dir /proc
says '/proc.*name a folder for temporary files with --temp-dir'

# --- view looks at the file before it looks for a display
unset DISPLAY WAYLAND_DISPLAY
expect 3 view missing.mnt
says 'missing.mnt: cannot open'
expect 6 view a.mnt
says 'no display'

# --- an option given twice: the last counts
expect 0 extract a.mnt --triangles 100 --triangles 2000 -o x.ply
grep -q ' 2000 triangles$' out.txt || fail "--triangles twice: $(cat out.txt)"
expect 0 replay a.mnt --path dive --path orbit --frames 9 --frames 2 --fps 0 --csv t.csv
[ "$(wc -l <t.csv)" -eq 3 ] || fail "--frames twice: $(wc -l <t.csv) lines"

# --- one of a thing
expect 0 replay a.mnt --path orbit --frames 1 --fps 0 --io sim --trace t.trace
expect 0 trace t.trace
grep -q '^run  *1 frame in ' out.txt || fail "one frame: $(grep ^run out.txt)"
head -c $(($(wc -c <a.mnt) - 1)) a.mnt >cut.mnt
expect 3 info cut.mnt
says "cut off: it has $(wc -c <cut.mnt) bytes, file_bytes is $(wc -c <a.mnt);"
expect 0 stress a.mnt --io pread --runs 1 --frames 20 --seed 7
grep -q ': 1 run, .* seed 7, ' out.txt || fail "one run: $(head -n 1 out.txt)"
grep -q '^  memory  *[0-9]* place holders (' out.txt || fail "one number of them: $(sed -n 2p out.txt)"

# --- what is measured: files are looked at before, nothing is called so, and of nothing there are no figures
for bench in adapt draw error simplify; do
    expect 2 bench $bench
    says "metanode: bench $bench: which FILE?.* see metanode bench $bench --help"
    file=one.ply
    [ $bench = error ] || [ $bench = simplify ] || file=one.mnt
    expect 3 bench $bench $file missing
    says 'missing: cannot'
    [ -s out.txt ] && fail "bench $bench begins though a file is missing: $(cat out.txt)"
done
expect 2 stress a.mnt --seconds 0
says "stress: --seconds '0' is not in 1 … 1000000 seconds"
expect 2 replay a.mnt --path orbit --triangles-max 99999999999
says "triangles-max '99999999999' is not in 1 …"
for command in "replay a.mnt --path orbit" "bench adapt a.mnt" "bench draw a.mnt"; do
    # shellcheck disable=SC2086 # a command and its words
    expect 2 $command --frames -1
    says "${command% a.mnt*}: --frames '-1' is not in 1 … 1000000"
done
expect 2 bench simplify one.ply --runs 0 --samples 0
says 'nothing is left to measure'
expect 2 bench draw one.mnt --frames 1
says 'frames 1: .*2 at least'
expect 0 bench error one.ply --samples 100
grep -q nan out.txt && fail "bench error: $(cat out.txt)"
grep -q ': 1 triangle, ' out.txt || fail "one triangle: $(cat out.txt)"
expect 0 bench adapt one.mnt --frames 2 --slow-frames 2
grep -q nan out.txt && fail "bench adapt: $(cat out.txt)"
{ sed -e 's/vertex 3/vertex 5/' -e 's/face 1/face 3/' -e '/^3 0 1 2$/d' one.ply &&
    printf '0 -1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 1 4\n'; } >fins.ply
"$metanode" bench simplify fins.ply --runs 1 --samples 0 >out.txt 2>err.txt
grep -q 'no helper\|not there' err.txt || {
    says '^metanode: fins.ply: OpenMesh, .*: not a manifold.*another mesh$'
}

exit $((failures > 0))
