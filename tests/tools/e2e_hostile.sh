#!/usr/bin/env bash
# Goal: nothing that a file or a user does wrong crashes the program, hangs it, fills the memory
# or leaves half a file behind; each gets its exit code and one line that names the place.
# Method: more than a hundred malformed inputs of every format under two seconds and 64 MB; a .mnt and a
# .vdt damaged field by field, without and with good checksums; caps and options.
# e2e_hostile.sh [BUILD [PART …]]      MN_SEED replays the random part
source "$(dirname "$0")/e2e_lib.sh"
source "$(dirname "$0")/e2e_shapes.sh"
cd "$scratch"
damage=$helpers/e2e_damage
seed=${MN_SEED:-1}

limits_on() { $sanitized || { seconds_max=2 megabytes_max=64; }; }
limits_off() { seconds_max=0 megabytes_max=0; }

# bad FILE NAME WORD…: no command makes a mesh of it; one line names the file and says each word.
bad() {
    local file=$1 name=$2
    shift 2
    expect 3 "$name" build "$file" -o never.mnt && one_line "$name" "$file" "$@"
    if [[ -e never.mnt ]]; then
        fail "$name: left an output behind"
        rm -f never.mnt
    fi
}

# ---- meshes -----------------------------------------------------------------------------------------

# cut FILE: every beginning of a text that ends at a line, but for the last `keep` lines.
cut_lines() {
    local file=$1 keep=${2-1} lines n
    lines=$(wc -l <"$file")
    for ((n = 0; n <= lines - keep; n++)); do
        head -n "$n" "$file" >"cut-$n-$file"
        bad "cut-$n-$file" "$file, $n of $lines lines"
    done
}

# cut_bytes FILE AT…
cut_bytes() {
    local file=$1 at
    for at in "${@:2}"; do
        head -c "$at" "$file" >"cut.$file"
        bad "cut.$file" "$file, $at bytes"
    done
}

tetrahedron_ply() { # vertex lines, then faces; header by the caller
    printf '0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n'
}

ply_head() { # vertices faces [vertex properties]
    printf 'ply\nformat ascii 1.0\nelement vertex %s\n%s\nelement face %s\nproperty list uchar int vertex_indices\nend_header\n' \
        "$1" "${3-property float x
property float y
property float z}" "$2"
}

ply_texts() {
    { ply_head 4 4; tetrahedron_ply; } >good.ply
    expect 0 "a good ply" build good.ply -o good.mnt
    cut_lines good.ply
    local count
    for count in 5 4000000000 99999999999999999999 -1 x ''; do
        { ply_head "$count" 4; tetrahedron_ply; } >count.ply
        bad count.ply "ply, $count vertices"
        { ply_head 4 "$count"; tetrahedron_ply; } >count.ply
        bad count.ply "ply, $count faces"
    done
    { ply_head 4 4; tetrahedron_ply | sed 's/^3 1 2 3/3 1 2 4/'; } >index.ply
    bad index.ply "ply, index out of range" "vertex 4 of 4"
    { ply_head 4 4; tetrahedron_ply | sed 's/^3 1 2 3/3 1 2 -1/'; } >index.ply
    bad index.ply "ply, negative index"
    { ply_head 4 4; tetrahedron_ply | sed 's/^3 1 2 3/2 1 2/'; } >two.ply
    expect 0 "ply, a face with two corners" build two.ply -o good.mnt --json &&
        equal "ply, a face with two corners" degenerate_faces 1
    { ply_head 4 4; tetrahedron_ply | sed 's/^3 1 2 3/999999999 1 2 3/'; } >list.ply
    bad list.ply "ply, a list longer than the file"
    { ply_head 4 4; tetrahedron_ply | sed 's/^1 0 0/1 zero 0/'; } >word.ply
    bad word.ply "ply, a word for a number"
    { ply_head 4 4 $'property real x\nproperty float y\nproperty float z'; tetrahedron_ply; } >type.ply
    bad type.ply "ply, no such type"
    { ply_head 4 4 $'property float x\nproperty float y'; tetrahedron_ply; } >xy.ply
    bad xy.ply "ply, no z"
    { ply_head 4 4 | sed 's/ascii 1.0/morse 1.0/'; tetrahedron_ply; } >format.ply
    bad format.ply "ply, no such format"
    { ply_head 4 4 | sed '/format/d'; tetrahedron_ply; } >format.ply
    bad format.ply "ply, no format"
    { printf 'ply\nformat ascii 1.0\ncomment '; head -c 3000000 /dev/zero | tr '\0' x; } >long.ply
    bad long.ply "ply, a header line of 3 MB"
    { printf 'ply\nformat ascii 1.0\n'; yes 'comment and so on' | head -n 100000; } >endless.ply
    bad endless.ply "ply, a header without end"
    { ply_head 4 1; tetrahedron_ply | sed 's/^3 0 2 1/3 0 0 1/'; } >flat.ply
    bad flat.ply "ply, no face left"
}

binary_files() {
    local size
    expect 0 "a ball" make sphere --triangles 500 -o ball.ply || return 0
    size=$(stat -c %s ball.ply)
    cut_bytes ball.ply 2 20 60 150 400 $((size / 2)) $((size - 13)) $((size - 1))
    head -c 200 ball.ply | sed 's/element face [0-9]*/element face 999999/' >lie.ply
    bad lie.ply "binary ply, more faces than bytes"
    sed 's/element vertex [0-9]*/element vertex 4294967295/' ball.ply >lie.ply
    bad lie.ply "binary ply, more vertices than bytes"
    { printf 'ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n'
        printf 'element face 1\nproperty list uchar int vertex_indices\nend_header\n'
        head -c 36 /dev/zero
        printf '\003\377\377\377\377\0\0\0\1\0\0\0\2'; } >big.ply
    bad big.ply "big-endian ply, index -1"
    { printf 'ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n'
        printf 'element tristrips 1\nproperty list int int vertex_indices\nend_header\n'
        head -c 36 /dev/zero
        printf '\377\377\377\177\0\0\0\0\1\0\0\0\2\0\0\0'; } >strips.ply
    bad strips.ply "tristrips longer than the file"

    { head -c 80 /dev/zero; printf '\2\0\0\0'; head -c 100 /dev/urandom; } >two.stl
    cut_bytes two.stl 83 84 133 183
    { head -c 80 /dev/zero; printf '\377\377\377\377'; head -c 100 /dev/zero; } >many.stl
    bad many.stl "stl, 4294967295 faces in 184 bytes"
    { head -c 80 /dev/zero; printf '\0\0\0\0'; } >none.stl
    bad none.stl "stl, no faces"
}

other_texts() {
    { echo 'solid s'; for x in 0 1; do
        printf 'facet normal 0 0 1\nouter loop\nvertex %s 0 0\nvertex %s 1 0\nvertex %s 0 1\nendloop\nendfacet\n' $x $x $x
    done; echo 'endsolid s'; } >good.stl
    expect 0 "a good stl" build good.stl -o good.mnt
    cut_lines good.stl 2
    sed 's/^vertex 1 1 0/vertex 1 one 0/' good.stl >word.stl
    bad word.stl "stl, a word for a number"

    printf 'OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n' >good.off
    expect 0 "a good off" build good.off -o good.mnt
    cut_lines good.off
    sed 's/^3 1 2 3/3 1 2 9/' good.off >index.off
    bad index.off "off, index out of range" "9"
    sed 's/^4 4 6/4 99999999 6/' good.off >count.off
    bad count.off "off, more faces than bytes"
    sed 's/^4 4 6/4294967297 4 6/' good.off >count.off
    bad count.off "off, more vertices than fit"

    printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >good.obj
    expect 0 "a good obj" build good.obj -o good.mnt
    local line name
    for line in 'f 1 2 4' 'f 0 1 2' 'f 1 2 -4' 'f a b c' 'f 1 2 99999999999999999999' 'v 1 2' 'v 1 2 z' 'v'; do
        { cat good.obj; echo "$line"; } >line.obj
        bad line.obj "obj, '$line'" 5
    done
    printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\n' >faceless.obj
    bad faceless.obj "obj, no faces"
    printf 'v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n' >nan.obj
    bad nan.obj "obj, nothing finite"
    { cat good.obj; printf 'f 1 2 3\0 4\n'; } >zero.obj
    expect 0,3 "obj, a zero byte" build zero.obj -o any.mnt
    { cat good.obj; printf 'f 1 2 3'; head -c 3000000 /dev/zero | tr '\0' ' '; } >wide.obj
    expect 0,3 "obj, a line of 3 MB" build wide.obj -o any.mnt
}

not_meshes() {
    : >empty
    bad empty "an empty file"
    mkdir folder
    bad folder "a folder"
    mkfifo fifo
    bad fifo "a fifo"
    expect 3 "compare, a fifo" compare fifo good.obj
    bad missing "no file"
    ln -s loop loop
    bad loop "a link to itself"
    bad /dev/zero "a device"
    head -c 100000 /dev/urandom >noise
    bad noise "noise"
    printf '\211PNG\r\n\032\n' >picture.png
    bad picture.png "a picture"
    bad hills.mnt "a .mnt where a mesh should be"
    bad tree.vdt "a .vdt where a mesh should be"
    local file command
    for file in good.obj empty folder fifo missing /dev/zero noise; do
        for command in "info $file" "verify $file" "extract $file --full -o never.ply" \
            "extract $file --error 0.001 -o never.ply" "block $file -o never.mnt" \
            "replay $file --path orbit" "shoot $file --path orbit --frame 0 -o never.png"; do
            # shellcheck disable=SC2086
            expect 3 "$command" $command && one_line "$command" "$file"
        done
    done
    printf 'metanode path 1\n0 0 9 0 0 0 0 1 0\n' >good.path
    expect 0 "a good path" replay hills.mnt --path good.path --fps 0
    local text
    for text in '' 'metanode path 3' 'metanode path 2' 'metanode path 1' $'metanode path 1\n1 2 3 4 5 6 7 8' \
        $'metanode path 1\n0 0 9 0 0 0 0 nan 0' $'metanode path 1\n0 0 9 0 0 0 0 1 0 1000' \
        $'metanode path 1\n0 0 9 0 0 0 0 1 0 45 1' $'metanode path 1\n0 0 9 0 0 x 0 1 0'; do
        echo "$text" >bad.path
        expect 3 "path '$text'" replay hills.mnt --path bad.path && one_line "path '$text'" bad.path
    done
    for file in folder noise fifo /dev/zero; do
        expect 3 "path $file" replay hills.mnt --path "$file" && one_line "path $file" "$file"
    done
    expect 2,3 "path of no name" replay hills.mnt --path nowhere && one_line "path of no name" nowhere
}

# ---- .mnt -------------------------------------------------------------------------------------------

# refused FILE NAME: every command that opens it.
refused() {
    local file=$1 name=$2 command
    for command in "info $file" "verify $file" "extract $file --full -o never.ply" "replay $file --path orbit --frames 2"; do
        # shellcheck disable=SC2086
        expect 3 "$name" $command && one_line "$name" "$file"
    done
}

# survived FILE NAME: nothing worse than a refusal, whatever it says; what navigates comes back.
survived() {
    local file=$1 name=$2
    expect 0,3 "$name" info "$file"
    expect 0,3 "$name" extract "$file" --triangles 500 -o any.ply
    expect 0,3 "$name" replay "$file" --path dive --frames 12 --fps 0 --settle --json -K 40 || return 0
    [[ $last -ne 0 ]] || equal "$name" back_at_roots true
    expect 0,3 "$name" replay "$file" --path orbit --frames 4 --store mapped --fps 0
}

# name offset type value: a value that cannot be, for each field of the header.
mnt_fields='magic 0 u8 0x6d
version 8 u32 9
header_bytes 12 u32 8192
checksum 16 u64 1
build_id 24 u64 1
file_bytes 32 u64 4096
triangles 40 u64 0xffffffffff
leaves 48 u32 1
nodes 52 u32 0xffffffff
hinges 56 u32 0x7fffffff
legal_last 60 u32 0xffffffff
flags 64 u32 2
metric 68 u32 2
blocking 72 u32 2
l 76 u32 17
block_bytes 80 u32 5000
block_bytes_max 84 u32 0xfffff000
blocks 88 u32 0
block_depth 92 u32 0
overflow_max 96 u32 0xffffffff
depth_max 100 u32 0
children_max 104 u32 0xffffffff
nodes_per_block_max 108 u32 0
fill_mean 112 f64 nan
origin 120 f64 inf
box_min 144 f32 nan
box_max 156 f32 -1e30
dive_point 168 f32 1e30
dive_normal 180 f32 9
roots 192 u32 129
zero 196 u32 1
root_id 200 u32 0
root_pages 204 u32 0
root_subtree 208 u32 999
rest 4092 u32 1'

# The same fields with values that could be, but are not so; checksums are good. Only metric, places
# and legal_last may go unnoticed by verify, which does not have the input.
mnt_lies='file_bytes 32 u64 1048576
triangles 40 u64 17
leaves 48 u32 1000
nodes 52 u32 2000
hinges 56 u32 9
flags 64 u32 0
blocking 72 u32 1
block_bytes_max 84 u32 65536
blocks 88 u32 5
block_depth 92 u32 9
overflow_max 96 u32 3
depth_max 100 u32 500
children_max 104 u32 1
nodes_per_block_max 108 u32 1
fill_mean 112 f64 0.01
roots 192 u32 2
root_id 200 u32 2
root_pages 204 u32 3
root_subtree 208 u32 1
build_id 24 u64 1'
mnt_may='legal_last 60 u32 6000
metric 68 u32 1
block_bytes 80 u32 16384
origin 120 f64 5
box_max 156 f32 100
dive_point 172 f32 0
roots 192 u32 0'

mnt_header() {
    local name offset type value
    while read -r name offset type value; do
        cp hills.mnt field.mnt
        "$damage" field.mnt put "$offset" "$type" "$value"
        refused field.mnt "header, $name damaged"
        case $name in
        checksum | build_id | zero | rest | root_subtree) continue ;; # see the lies
        esac
        "$damage" field.mnt seal
        refused field.mnt "header, $name cannot be, sealed"
    done <<<"$mnt_fields"
    while read -r name offset type value; do
        cp hills.mnt lie.mnt
        "$damage" lie.mnt put "$offset" "$type" "$value" seal
        expect 3 "header, $name lies" verify lie.mnt && one_line "header, $name lies" lie.mnt
        survived lie.mnt "header, $name lies"
    done <<<"$mnt_lies"
    while read -r name offset type value; do
        cp hills.mnt lie.mnt
        "$damage" lie.mnt put "$offset" "$type" "$value" seal
        expect 0,3 "header, $name lies" verify lie.mnt
        survived lie.mnt "header, $name lies"
    done <<<"$mnt_may"
}

mnt_cut() {
    local size at
    size=$(stat -c %s hills.mnt)
    for at in 1 100 4095 4096 5000 8192 $((size / 2)) $((size - 4096)) $((size - 1)); do
        head -c "$at" hills.mnt >cut.mnt
        refused cut.mnt "a .mnt of $at bytes"
    done
    { cat hills.mnt; echo more; } >longer.mnt
    refused longer.mnt "a .mnt with more behind it"
}

# A block that cannot be read is less detail to a navigation, and exit 3 to what needs all of it.
damaged_block() {
    local id
    id=$("$damage" hills.mnt blocks | awk '$6 > 0 && $4 == 0 {print $1; exit}')
    cp hills.mnt inner.mnt
    "$damage" inner.mnt add $((id * 4096 + 1000)) 1
    local command
    for command in "verify inner.mnt" "extract inner.mnt --full -o never.ply" \
        "extract inner.mnt --error 0 -o never.ply" "block inner.mnt -o never.mnt"; do
        # shellcheck disable=SC2086
        expect 3 "$command, block $id damaged" $command && one_line "$command" inner.mnt "block $id" checksum
    done
    local store
    for store in paged mapped resident; do
        expect 0 "block $id damaged, $store" replay inner.mnt --path dive --frames 60 --fps 0 --settle --json \
            --store $store --degrade off || continue
        equal "block $id damaged, $store" back_at_roots true
        holds "block $id damaged, $store: counted" "$(figures checksum_failures) >= 1"
    done
    cp hills.mnt root.mnt
    "$damage" root.mnt add 5000 1
    for command in "verify root.mnt" "extract root.mnt --full -o never.ply" \
        "extract root.mnt --error 0 -o never.ply" "replay root.mnt --path orbit" \
        "replay root.mnt --path orbit --store mapped" "replay root.mnt --path orbit --store resident"; do
        # shellcheck disable=SC2086
        expect 3 "$command, root block damaged" $command && one_line "$command" root.mnt "block 1"
    done
}

# Blocks whose checksums are good and whose contents lie: verify sees each, nothing else falls.
lying_blocks() {
    local line id pages kind refs payload parent what steps
    while read -r id pages kind refs payload parent; do
        local at=$((id * 4096))
        while IFS='|' read -r what steps; do
            cp hills.mnt lie.mnt
            # shellcheck disable=SC2086
            "$damage" lie.mnt $steps seal-block "$id" || continue
            expect 3 "block $id: $what" verify lie.mnt && one_line "block $id: $what" lie.mnt
            survived lie.mnt "block $id: $what"
        done <<END
magic|put $at u32 0
kind 2|put $((at + 4)) u32 2
kind 9|put $((at + 4)) u32 9
build id|add $((at + 16)) 1
id|add $((at + 24)) 1
refs|add $((at + 32)) 1
refs without end|put $((at + 32)) u32 0xffffffff
payload bytes|add $((at + 36)) 64
payload without end|put $((at + 36)) u32 0xffffffff
parent|add $((at + 40)) 1
zero|add $((at + 44)) 1
nodes|add $payload 1
nodes without end|put $payload u32 0xffffffff
no nodes|put $payload u32 0
no subtrees|put $((payload + 4)) u32 0
subtrees|add $((payload + 4)) 1
exits|add $((payload + 8)) 1
simplices|add $((payload + 12)) 1
simplices without end|put $((payload + 12)) u32 0xffffffff
colours|put $((payload + 16)) u32 2
order ids|add $((payload + 24)) 1
switch values are nan|put $((payload + 28)) u32 0x1ff0
switch values|add $((payload + 28)) -1
radii are nan|put $((payload + 32)) u32 0xff8
radii|add $((payload + 32)) -1
positions|put $((payload + 24 + 4 * 7)) u32 0xffc00000
leaf_lo|add $((payload + 24 + 4 * 13)) 1
far corners|add $((payload + 80)) 1
switch values begin late|add $((payload + 84 + 2 * 1)) 1
left begins late|add $((payload + 84 + 2 * 6)) 1
positions begin late|add $((payload + 84 + 2 * 7)) 1
exits begin late|add $((payload + 84 + 2 * 16)) 1
lack ends late|add $((payload + 84 + 2 * 19)) 1
simplices begin late|add $((payload + 84 + 2 * 20)) 1
second corners begin late|add $((payload + 84 + 2 * 23)) 1
third corners begin late|add $((payload + 84 + 2 * 24)) 1
simplices end late|add $((payload + 84 + 2 * 25)) 1
exits end late|add $((payload + 84 + 2 * 28)) 1
leaf_lo begins late|add $((payload + 84 + 2 * 30)) 1
sizes begin late|add $((payload + 84 + 2 * 31)) 1
a field without end|put $((payload + 84 + 2 * 7)) u16 0xffff
fields in disorder|put $((payload + 84 + 2 * 7)) u16 0
END
    done < <("$damage" hills.mnt blocks | awk 'NR == 1 || $6 > 0 && ++n == 3')
    # references: round in a circle, out of the file, twice the same
    id=$("$damage" hills.mnt blocks | awk '$4 >= 2 {print $1; exit}')
    for steps in "put $((id * 4096 + 48)) u32 $id" "put $((id * 4096 + 48)) u32 0" \
        "put $((id * 4096 + 48)) u32 0x7fffffff" "put $((id * 4096 + 52)) u32 0" \
        "put $((id * 4096 + 52)) u32 0xffffffff" "add $((id * 4096 + 48)) 1"; do
        cp hills.mnt lie.mnt
        # shellcheck disable=SC2086
        "$damage" lie.mnt $steps seal-block "$id"
        expect 3 "reference: $steps" verify lie.mnt && one_line "reference: $steps" lie.mnt
        survived lie.mnt "reference: $steps"
    done
}

# Any byte of any block, checksum good.
random_lies() {
    local turn file size at block
    RANDOM=$seed
    echo "seed $seed"
    for ((turn = 0; turn < 40; turn++)); do
        file=$([[ $((turn % 2)) -eq 0 ]] && echo hills || echo levels).mnt
        size=$(stat -c %s $file)
        at=$((4096 + (RANDOM * 32768 + RANDOM) % (size - 4096)))
        block=$("$damage" $file blocks | awk -v at=$at '$1 * 4096 <= at {id = $1} END {print id}')
        cp $file lie.mnt
        "$damage" lie.mnt put $at u8 $((RANDOM % 256)) seal-block "$block"
        expect 0,3 "seed $seed: byte $at of $file" verify lie.mnt
        survived lie.mnt "seed $seed: byte $at of $file"
    done
}

# ---- .vdt -------------------------------------------------------------------------------------------

vdt_fields='magic 0 u8 0x6d
version 8 u32 9
header_bytes 12 u32 4096
checksum 16 u64 1
build_id 24 u64 1
file_bytes 32 u64 288
leaves 40 u32 0xffffffff
inner 44 u32 3
simplices 48 u32 0xffffffff
triangles 52 u32 0xffffffff
roots 56 u32 0
legal_last 60 u32 0xffffffff
depth_max 64 u32 1
metric 68 u32 2
flags 72 u32 2
grid_step 76 f32 0.3
origin 80 f64 nan
section_offset 240 u64 0xffffffffffff
section_bytes 248 u64 3
simplices_bytes 272 u64 0xffffffffffffffff'

vdt_refused() {
    local name=$1
    expect 3 "$name" info bad.vdt && one_line "$name" bad.vdt
    vdt_lies "$name"
}

# What agrees with its checksum and is not so is for those to find who go through the tree: info does not.
vdt_lies() {
    local name=$1 command
    for command in "verify bad.vdt" "extract bad.vdt --full -o never.ply" \
        "extract bad.vdt --error 0.001 -o never.ply" "block bad.vdt -o never.mnt"; do
        # shellcheck disable=SC2086
        expect 3 "$name" $command && one_line "$name" bad.vdt
    done
}

vdt_files() {
    local name offset type value size at start bytes section record
    while read -r name offset type value; do
        cp tree.vdt bad.vdt
        "$damage" bad.vdt put "$offset" "$type" "$value"
        vdt_refused ".vdt, $name damaged"
        [[ $name != checksum && $name != build_id ]] || continue
        "$damage" bad.vdt seal
        [[ $name == depth_max ]] || vdt_refused ".vdt, $name damaged, sealed"
        [[ $name != depth_max ]] || vdt_lies ".vdt, $name damaged, sealed"
    done <<<"$vdt_fields"
    size=$(stat -c %s tree.vdt)
    for at in 7 8 100 287 288; do
        head -c "$at" tree.vdt >bad.vdt
        vdt_refused ".vdt of $at bytes"
    done
    # cut at the end of a section; a record of each, word by word, without and with good checksums
    for section in 0 1; do
        read -r start bytes < <(od -An -t u8 -j $((240 + 24 * section)) -N 16 tree.vdt)
        [[ $((start + bytes)) -ge $size ]] || head -c $((start + bytes)) tree.vdt >bad.vdt
        [[ $((start + bytes)) -ge $size ]] || vdt_refused ".vdt without what follows section $section"
        record=$([[ $section -eq 0 ]] && echo 52 || echo 12)
        for ((at = 0; at < record; at += 4)); do
            [[ $section,$at != 0,12 ]] || continue # a colour may be any
            cp tree.vdt bad.vdt
            "$damage" bad.vdt put $((start + bytes / record / 2 * record + at)) u32 0xfffffff0
            [[ $at -gt 0 ]] || vdt_refused ".vdt, section $section damaged"
            "$damage" bad.vdt seal
            vdt_lies ".vdt, section $section lies at $at of a record"
        done
    done
}

# ---- caps, options ---------------------------------------------------------------------------

# smallest NAME: the size that the last error names.
smallest() { grep -oE '[0-9]+(\.[0-9]+)?[KMG]?' <<<"$(grep -oE -- '--ram [0-9.]+[KMG]?' "$err" | tail -1)"; }

caps() {
    local ram
    limits_off
    expect 5 "build under 1 MB" build mountains.ply -o mountains.mnt --ram 1M || return 0
    one_line "build under 1 MB" mountains.ply --ram
    ram=$(smallest)
    expect 0 "build under $ram" build mountains.ply -o mountains.mnt --ram "$ram" --json &&
        { $sanitized || holds "build under $ram" "$(figures rss_peak_bytes) <= $(figures ram_cap_bytes)"; }
    expect 5 "replay under 64K" replay hills.mnt --path orbit --ram 64K && one_line "replay under 64K" --ram
    ram=$(smallest)
    expect 0 "replay under $ram" replay hills.mnt --path orbit --ram "$ram" --frames 20 --fps 0 --settle --json &&
        equal "replay under $ram" back_at_roots true
    expect 5 "-K 100000 under 8M" replay hills.mnt --path orbit --ram 8M -K 100000 && one_line "-K 100000" --ram
    ram=$(smallest)
    expect 0 "-K 100000 under $ram" replay hills.mnt --path orbit --ram "$ram" -K 100000 --frames 5 --fps 0
    expect 2,5 "-K 1" replay hills.mnt --path orbit -K 1 && one_line "-K 1"
    limits_on
}

wrong_usage() {
    local line
    while read -r line; do
        # shellcheck disable=SC2086
        expect 2 "metanode $line" $line
        [[ -z $line ]] || one_line "metanode $line"
    done <<'END'
nonsense
build
build good.obj
build good.obj good.ply -o x.mnt
build good.obj -o x.mnt --nonsense
make sphere --triangles 5kk -o x.ply
make sphere --triangles 5Q -o x.ply
make sphere --triangles 99999999999G -o x.ply
make sphere --times 2 -o x.ply
make subdivide good.obj --times 1 --triangles 5 -o x.ply
make earth --seed 5 -o x.ply
build good.obj -o
build good.obj -o x.mnt --ram
build good.obj -o x.mnt --ram lots
build good.obj -o x.mnt --ram -5M
build good.obj -o x.mnt --ram 0
build good.obj -o x.mnt --metric beauty
build good.obj -o x.mnt --blocking levels -L 0
build good.obj -o x.mnt --blocking levels -L 99
build good.obj -o x.mnt --block-bytes 5000
build good.obj -o x.mnt --block-bytes 2G
build good.obj -o x.mnt -L 5
build good.obj -o x.mnt --weld maybe
build good.obj -o x.mnt --reader braille
build good.obj -o x.mnt -j 0
simplify good.obj -o x.vdt --blocking packed
block tree.vdt -o x.mnt --metric qem
info
info good.mnt good.mnt
verify
verify good.mnt --against
extract good.mnt -o x.ply
extract good.mnt --full
extract good.mnt --full --triangles 5 -o x.ply
extract good.mnt --triangles many -o x.ply
extract good.mnt --triangles -1 -o x.ply
extract good.mnt --error -1 -o x.ply
extract good.mnt --error nan -o x.ply
replay good.mnt
replay --path orbit
replay good.mnt --path orbit --store heap
replay good.mnt --path orbit --io carrier-pigeon
replay good.mnt --path orbit -K none
replay good.mnt --path orbit -K 0
replay good.mnt --path orbit --size 0x0
replay good.mnt --path orbit --size large
replay good.mnt --path orbit --fov 0
replay good.mnt --path orbit --fov 200
replay good.mnt --path orbit --frames 0
replay good.mnt --path orbit --frames -1
replay good.mnt --path orbit --fps -1
replay good.mnt --path orbit --tolerance nan
replay good.mnt --path orbit --nav-ops x
replay good.mnt --path orbit --degrade perhaps
replay good.mnt --path orbit --open slowly
replay good.mnt --path orbit --frustum 0.5
replay good.mnt --path orbit --cones perhaps
replay good.mnt --path orbit --silhouettes 1001
replay good.mnt --path orbit --light 0,0,0
replay good.mnt --path orbit --light 1,2
replay good.mnt --path orbit --light nan,0,1
replay good.mnt --path orbit --light-factor x
replay good.mnt --path orbit --triangles-max 0
replay good.mnt --path orbit --triangles-max many
replay good.mnt --path orbit --triangles-max 100 --degrade off
replay good.mnt --path orbit --seed x
shoot good.mnt --path orbit --frame 5
shoot good.mnt --path orbit --frame x -o x.png
make
make cube -o x.ply
make sphere
make sphere --triangles 0 -o x.ply
make sphere --triangles some -o x.ply
make sphere --etopo good.obj -o x.ply
make terrain --stride 2 -o x.ply
make earth --etopo good.obj
make earth --etopo good.obj --triangles 5000 -o x.ply
make earth --etopo good.obj --seed 1 -o x.ply
make earth --etopo good.obj --stride 0 -o x.ply
make earth --etopo good.obj --exaggeration 0 -o x.ply
make earth --etopo good.obj -o good.obj
make subdivide -o x.ply --times 1
make subdivide good.obj --times 0 -o x.ply
compare good.obj
compare good.obj good.obj good.obj
compare good.obj good.obj --samples 0
bench press
tune good.obj
END
}

limits_off
expect 0 hills make terrain --triangles 6000 --seed 5 -o hills.ply || finish
expect 0 mountains make terrain --triangles 60000 --seed 5 -o mountains.ply || finish
expect 0 hills build hills.ply -o hills.mnt --block-bytes 4096 || finish
expect 0 hills build hills.ply -o levels.mnt --blocking levels -L 4 || finish
expect 0 hills simplify hills.ply -o tree.vdt || finish
limits_on
shift || true
[[ $# -gt 0 ]] || set -- ply_texts binary_files other_texts not_meshes mnt_header mnt_cut damaged_block \
    lying_blocks random_lies vdt_files caps wrong_usage
for name in "$@"; do
    part "$name"
done
finish
