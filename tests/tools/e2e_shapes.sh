# Made meshes for the end-to-end scripts, as OBJ on standard output: shape NAME. Each is small, exact
# and there for one property; the comments say which.

# Functions of awk: v() writes a vertex and numbers it from 1, f() a triangle.
shape_awk='
function v(x, y, z) { printf "v %.9g %.9g %.9g\n", x, y, z; return ++V }
function f(a, b, c) { printf "f %d %d %d\n", a, b, c }
function octahedron(x, y, z, r,   i, c) {
    for (i = 0; i < 6; i++)
        c[i] = v(x + r * (i == 0) - r * (i == 1), y + r * (i == 2) - r * (i == 3), z + r * (i == 4) - r * (i == 5))
    f(c[0], c[2], c[4]); f(c[2], c[1], c[4]); f(c[1], c[3], c[4]); f(c[3], c[0], c[4])
    f(c[2], c[0], c[5]); f(c[1], c[2], c[5]); f(c[3], c[1], c[5]); f(c[0], c[3], c[5])
}
# A grid of w × h cells that is closed (cu, cv: 1) in either direction or open (0); place() is the shape.
function grid(w, h, cu, cv,   i, j, p, q) {
    p = w + !cu; q = h + !cv
    for (j = 0; j < q; j++)
        for (i = 0; i < p; i++)
            at[i, j] = place(i / w, j / h)
    for (j = 0; j < h; j++)
        for (i = 0; i < w; i++) {
            f(at[i, j], at[(i + 1) % p, j], at[(i + 1) % p, (j + 1) % q])
            f(at[i, j], at[(i + 1) % p, (j + 1) % q], at[i, (j + 1) % q])
        }
}
function place(u, w,   a, b) {
    if (SHAPE == "sheet")
        return v(u, 0.1 * sin(7 * u) * cos(5 * w), w)
    a = 2 * PI * u; b = 2 * PI * w
    return v((2 + 0.7 * cos(b)) * cos(a), 0.7 * sin(b), -(2 + 0.7 * cos(b)) * sin(a))
}
# Latitudes and meridians; every meridian meets at the poles.
function globe(meridians, rows,   i, j, first, north, south) {
    for (j = 1; j < rows; j++)
        for (i = 0; i < meridians; i++)
            first = v(sin(PI * j / rows) * cos(2 * PI * i / meridians), cos(PI * j / rows),
                      -sin(PI * j / rows) * sin(2 * PI * i / meridians))
    north = v(0, 1, 0); south = v(0, -1, 0); first = (rows - 2) * meridians
    for (i = 0; i < meridians; i++) {
        f(north, 1 + i, 1 + (i + 1) % meridians)
        f(south, 1 + first + (i + 1) % meridians, 1 + first + i)
        for (j = 0; j < rows - 2; j++) {
            f(1 + j * meridians + i, 1 + (j + 1) * meridians + i, 1 + (j + 1) * meridians + (i + 1) % meridians)
            f(1 + j * meridians + i, 1 + (j + 1) * meridians + (i + 1) % meridians, 1 + j * meridians + (i + 1) % meridians)
        }
    }
}
BEGIN { PI = atan2(0, -1) }'

shape() {
    local body
    case $1 in
    # a hundred parts of different sizes: virtual edges join them
    components) body='for (k = 0; k < 100; k++) octahedron(3 * (k % 10), 0.1 * k, 3 * int(k / 10), 1 + 0.01 * k)' ;;
    # genus 1, closed
    torus) body='grid(60, 30, 1, 1)' ;;
    # one boundary
    sheet) body='grid(40, 40, 0, 0)' ;;
    # four wings along each edge of a spine: non-manifold edges and vertices
    fins) body='for (k = 0; k <= 40; k++) { s[k] = v(k, 0, 0)
        for (w = 0; w < 4; w++) t[k, w] = v(k, sin(PI * w / 2 + 0.1), cos(PI * w / 2 + 0.1)) }
        for (k = 0; k < 40; k++) for (w = 0; w < 4; w++) {
            f(s[k], s[k + 1], t[k + 1, w]); f(s[k], t[k + 1, w], t[k, w]) }' ;;
    # separate triangles: nothing but ears
    lone) body='for (k = 0; k < 300; k++) { x = 2 * (k % 20); z = 2 * int(k / 20)
        f(v(x, 0, z), v(x + 1, 0.1 * (k % 7), z), v(x, 0, z + 1)) }' ;;
    # every face once more, every second one of them turned round
    twice) body='for (k = 0; k < 2; k++) octahedron(5 * k, 0, 0, 1); V = 0
        for (k = 0; k < 2; k++) { b = 6 * k
        f(b+3, b+5, b+1); f(b+3, b+2, b+5); f(b+2, b+4, b+5); f(b+4, b+5, b+1)
        f(b+3, b+1, b+6); f(b+3, b+2, b+6); f(b+4, b+2, b+6); f(b+1, b+6, b+4) }' ;;
    one) body='f(v(0, 0, 0), v(1, 0, 0), v(0, 1, 0))' ;;
    # triangles without area, each with three vertices: kept
    flat) body='for (k = 0; k <= 12; k++) a[k] = v(k, 0, 0)
        for (k = 0; k < 11; k++) f(a[k], a[k + 1], a[k + 2])' ;;
    # two fans that share nothing but their middle
    bowtie) body='m = v(0, 0, 0); for (k = 0; k <= 8; k++) {
        a[k] = v(1 + 0.1 * k, cos(PI * k / 8), sin(PI * k / 8)); b[k] = v(-1 - 0.1 * k, cos(PI * k / 8), sin(PI * k / 8)) }
        for (k = 0; k < 8; k++) { f(m, a[k], a[k + 1]); f(m, b[k + 1], b[k]) }' ;;
    # an edge with 3,000 faces that die one after the other: a tree 1,500 deep
    book) body='a = v(0, 0, 0); b = v(0, 1, 0); for (k = 0; k < 3000; k++)
        f(a, b, v(cos(2 * PI * k / 3000), 0.5 + 0.2 * sin(k), sin(2 * PI * k / 3000)))' ;;
    # an edge in two short halves: 1,000 faces die in one collapse, more than a small block holds
    spine) body='a = v(0, 0, 0); m = v(0, 0.0001, 0); b = v(0, 0.0002, 0); for (k = 0; k < 1000; k++) {
        w = v(cos(PI * k / 500), 0, sin(PI * k / 500)); f(a, m, w); f(m, b, w) }' ;;
    # two vertices with 3,000 neighbours each
    pole) body='globe(3000, 4)' ;;
    # one side only: cannot be oriented
    moebius) body='for (k = 0; k < 60; k++) for (w = -1; w <= 1; w++) { a = 2 * PI * k / 60
        at[k, w] = v((3 + w * cos(a / 2)) * cos(a), w * sin(a / 2), (3 + w * cos(a / 2)) * sin(a)) }
        for (k = 0; k < 60; k++) for (w = -1; w < 1; w++) { n = (k + 1) % 60; t = n == 0 ? -1 : 1
        f(at[k, w], at[n, t * w], at[n, t * (w + 1)]); f(at[k, w], at[n, t * (w + 1)], at[k, w + 1]) }' ;;
    # doubled vertices, unused ones, polygons, faces to reject: 4 triangles stay
    dirty) body='for (k = 0; k < 2; k++) { v(0, 0, 0); v(1, 0, 0); v(1, 1, 0); v(0, 1, 0) }
        v(9, 9, 9); v(0, 0, 1); v("nan", 0, 0)
        print "f 1 2 3 4"; print "f 1 1 2"; print "f 5 6 7"; print "f 6 7 10"; print "f 8 5 10"; print "f 1 2 11"' ;;
    *) echo "no shape $1" >&2; return 1 ;;
    esac
    awk -v SHAPE="$1" "$shape_awk"' BEGIN {'"$body"'}' </dev/null
}
