/* Duplicate and wrongly oriented triangles, found in linear time with good locality.
 *
 * Secret: half-edge h = 3t + i runs from corner[h] to the next corner of triangle t. A counting
 * sort groups half-edges by the vertex they leave, in input order. A duplicate shares the vertex
 * with the smallest number: it is looked for among the half-edges there. A directed edge used twice
 * leaves the same vertex twice. Both look at one vertex at a time: all against all where it has
 * few triangles, through a hash table where it has many.
 *
 *   first[v]      first[v + 1]
 *      |  h  h  h  h  |  h  h  h ...      sorted by corner[h], then by h
 *
 * Threads: any, each call on its own. Memory: 4 bytes a half-edge and a vertex, 2 bits a triangle,
 * and 10.7 bytes a triangle of the largest star; freed before the return. (design.md §3.1) */
#include "faces.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "table.h"

#include <xxhash.h>

enum { STAR_FEW = 24 }; /* compared all against all: in registers and cache, faster than hashing */

typedef struct faces {
    const uint32_t *corner;
    uint32_t *half_edge; /* grouped */
    uint32_t *first;     /* vertices + 1 */
    uint64_t *duplicate; /* bits */
    uint64_t *misoriented;
    mni_table table; /* for one star at a time */
    uint64_t spare_bytes, missing_bytes;
    uint64_t seed;
} faces;

/* What two half-edges of one star must share to be the same. */
typedef uint64_t (*half_edge_key)(const faces *f, uint32_t half_edge);

static uint32_t next_in_triangle(uint32_t half_edge) {
    return half_edge % 3 == 2 ? half_edge - 2 : half_edge + 1;
}

static bool bit(const uint64_t *bits, uint32_t at) {
    return (bits[at / 64] >> (at % 64) & 1) != 0;
}

static void set_bit(uint64_t *bits, uint32_t at) {
    bits[at / 64] |= UINT64_C(1) << (at % 64);
}

static uint64_t bitmap_bytes(uint64_t bits) {
    return (bits / 64 + 1) * sizeof(uint64_t);
}

uint64_t mni_faces_bytes(uint64_t vertices, uint64_t triangles) {
    return 3 * triangles * sizeof(uint32_t)    /* half_edge */
           + (vertices + 1) * sizeof(uint32_t) /* first */
           + 2 * bitmap_bytes(triangles);      /* duplicate, misoriented */
}

/* The edge from a common vertex: where it goes. */
static uint64_t edge_key(const faces *f, uint32_t half_edge) {
    return f->corner[next_in_triangle(half_edge)];
}

/* The triangle with a common vertex: its other two, the smaller first. */
static uint64_t triangle_key(const faces *f, uint32_t half_edge) {
    uint32_t next = next_in_triangle(half_edge);
    uint32_t b = f->corner[next], c = f->corner[next_in_triangle(next)];
    return b < c ? (uint64_t)b << 32 | c : (uint64_t)c << 32 | b;
}

/* Marks the triangles whose half-edge has a key that an earlier one of the list has. */
static void mark_repeats_few(const faces *f, const uint32_t *list, uint32_t count,
                             half_edge_key key_of, uint64_t *marks) {
    uint64_t key[STAR_FEW];
    for (uint32_t i = 0; i < count; i++) {
        key[i] = key_of(f, list[i]);
        for (uint32_t j = 0; j < i; j++) {
            if (key[j] == key[i]) {
                set_bit(marks, list[i] / 3);
                break;
            }
        }
    }
}

static mn_code mark_repeats_many(faces *f, const uint32_t *list, uint32_t count,
                                 half_edge_key key_of, uint64_t *marks) {
    uint64_t bytes = mni_table_bytes(count);
    if (bytes > f->spare_bytes) {
        f->missing_bytes = bytes - f->spare_bytes;
        return MN_CAP_TOO_SMALL;
    }
    if (!mni_table_open(&f->table, count))
        return MN_FAILED;
    for (uint32_t i = 0; i < count; i++) {
        uint64_t key = key_of(f, list[i]);
        uint64_t hash = XXH3_64bits_withSeed(&key, sizeof key, f->seed);
        uint64_t at = mni_table_first(&f->table, hash);
        uint32_t other;
        bool known = false;
        while (!known && mni_table_find(&f->table, hash, &at, &other)) {
            known = key_of(f, other) == key;
            at = mni_table_next(&f->table, at);
        }
        if (known)
            set_bit(marks, list[i] / 3);
        else
            mni_table_put(&f->table, at, hash, list[i]);
    }
    mni_table_close(&f->table);
    return MN_OK;
}

static mn_code mark_repeats(faces *f, const uint32_t *list, uint32_t count, half_edge_key key_of,
                            uint64_t *marks) {
    if (count > STAR_FEW)
        return mark_repeats_many(f, list, count, key_of, marks);
    mark_repeats_few(f, list, count, key_of, marks);
    return MN_OK;
}

/* Groups half-edges by the vertex they leave. */
static void group(faces *f, uint64_t vertices, uint64_t triangles) {
    uint64_t half_edges = 3 * triangles;
    for (uint64_t h = 0; h < half_edges; h++)
        f->first[f->corner[h]]++;
    uint32_t sum = 0;
    for (uint64_t v = 0; v < vertices; v++) {
        sum += f->first[v];
        f->first[v] = sum; /* the end of v's; filling from the back leaves its beginning */
    }
    f->first[vertices] = sum;
    for (uint64_t h = half_edges; h-- > 0;)
        f->half_edge[--f->first[f->corner[h]]] = (uint32_t)h;
    MN_ASSERT(sum == half_edges && f->first[0] == 0);
}

/* Leaves the half-edges of triangles that are no duplicates, in order. */
static uint32_t keep_singles(const faces *f, uint32_t *list, uint32_t count) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++)
        if (!bit(f->duplicate, list[i] / 3))
            list[kept++] = list[i];
    return kept;
}

/* All duplicates of a triangle are in each of its stars, so one star after the other will do. */
static mn_code mark_all(faces *f, uint64_t vertices) {
    for (uint64_t v = 0; v < vertices; v++) {
        uint32_t *list = f->half_edge + f->first[v];
        uint32_t count = f->first[v + 1] - f->first[v];
        mn_code code = mark_repeats(f, list, count, triangle_key, f->duplicate);
        if (code != MN_OK)
            return code;
        count = keep_singles(f, list, count);
        code = mark_repeats(f, list, count, edge_key, f->misoriented);
        if (code != MN_OK)
            return code;
    }
    return MN_OK;
}

static uint64_t drop_duplicates(const faces *f, uint32_t *corner, uint64_t triangles,
                                mn_intake *counts) {
    uint64_t kept = 0;
    for (uint64_t t = 0; t < triangles; t++) {
        if (bit(f->duplicate, (uint32_t)t))
            continue;
        counts->misoriented_faces += bit(f->misoriented, (uint32_t)t);
        memmove(corner + 3 * kept, corner + 3 * t, 3 * sizeof *corner);
        kept++;
    }
    counts->duplicate_faces += triangles - kept;
    return kept;
}

mn_code mni_faces_filter(uint32_t *corner, uint64_t *triangles, uint64_t vertices,
                         uint64_t spare_bytes, uint64_t *missing_bytes, mn_intake *counts) {
    MN_ASSERT(*triangles <= (UINT32_MAX - 1) / 3);
    faces f = {.corner = corner,
               .half_edge = malloc(3 * *triangles * sizeof(uint32_t) + 1),
               .first = calloc(vertices + 1, sizeof(uint32_t)),
               .duplicate = calloc(1, bitmap_bytes(*triangles)),
               .misoriented = calloc(1, bitmap_bytes(*triangles)),
               .spare_bytes = spare_bytes,
               /* an address: no file can be made to hash badly, and no result depends on it */
               .seed = (uint64_t)(uintptr_t)corner};
    mn_code code = MN_FAILED;
    if (f.half_edge != NULL && f.first != NULL && f.duplicate != NULL && f.misoriented != NULL) {
        group(&f, vertices, *triangles);
        code = mark_all(&f, vertices);
    }
    if (code == MN_OK)
        *triangles = drop_duplicates(&f, corner, *triangles, counts);
    *missing_bytes = f.missing_bytes;
    free(f.misoriented);
    free(f.duplicate);
    free(f.first);
    free(f.half_edge);
    return code;
}
