/* Triangles of a mesh on disk: packed, since along a curve neighbours' numbers are near each other.
 *
 *   smallest - the last one's, next - smallest, last - smallest      varints: 5 bytes, of 12
 *
 * Written by who makes a mesh (put), read from front to back as often as one likes (open, next). No
 * memory but the reader's buffer. One thread. */
#ifndef MNI_EXTTRIANGLES_H
#define MNI_EXTTRIANGLES_H

#include "extmesh.h"
#include "varint.h"

enum { MNI_EXTTRIANGLE_MAX = 3 * MNI_VARINT32_MAX };

/* Turned: its smallest corner first. */
static inline mni_exttriangle mni_exttriangle_turned(uint32_t a, uint32_t b, uint32_t c) {
    if (b < a && b < c)
        return (mni_exttriangle){{b, c, a}};
    return c < a && c < b ? (mni_exttriangle){{c, a, b}} : (mni_exttriangle){{a, b, c}};
}

/* A triangle's corners are in so many thousands of vertices more than one. */
static inline uint32_t mni_exttriangle_crossings(const mni_exttriangle *t) {
    const uint32_t a = t->corner[0] >> 10, b = t->corner[1] >> 10, c = t->corner[2] >> 10;
    return (uint32_t)(b != a) + (uint32_t)(c != a && c != b);
}

/* Turned, the smallest no smaller than that of the last one, which is 0 at first. */
static inline void mni_exttriangle_put(mni_spill_writer *w, const mni_exttriangle *t,
                                       uint32_t *last) {
    unsigned char packed[MNI_EXTTRIANGLE_MAX];
    unsigned char *to = mni_varint_put(packed, t->corner[0] - *last);
    to = mni_varint_put(to, t->corner[1] - t->corner[0]);
    to = mni_varint_put(to, t->corner[2] - t->corner[0]);
    mni_spill_put(w, packed, (size_t)(to - packed));
    *last = t->corner[0];
}

typedef struct mni_exttriangles {
    mni_spill_reader bytes;
    mni_exttriangle is;
} mni_exttriangles;

static inline void mni_exttriangles_open(mni_exttriangles *r, mni_extmesh *mesh, void *buffer,
                                         size_t buffer_bytes) {
    *r = (mni_exttriangles){0};
    mni_spill_reader_open(&r->bytes, &mesh->triangle, 0, mesh->triangle.size_bytes, buffer,
                          buffer_bytes, false);
}

/* The next one, where it stays until the next call. NULL: that was all, or the spill has failed. */
static inline const mni_exttriangle *mni_exttriangles_next(mni_exttriangles *r) {
    const unsigned char *at = mni_spill_peek(&r->bytes, MNI_EXTTRIANGLE_MAX);
    if (at == NULL)
        return NULL;
    uint32_t *c = r->is.corner;
    c[0] += (uint32_t)mni_varint_get(&at);
    c[1] = c[0] + (uint32_t)mni_varint_get(&at);
    c[2] = c[0] + (uint32_t)mni_varint_get(&at);
    mni_spill_skip(&r->bytes, at);
    return &r->is;
}

#endif
