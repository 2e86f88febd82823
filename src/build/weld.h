/* Vertices as they come from a file, those at equal positions made one.
 *
 * Each vertex that is added has a place in the caller's array of numbers, which gets the number of
 * the vertex that it became, at the latest with mni_weld_flush. Threads: one. */
#ifndef MNI_WELD_H
#define MNI_WELD_H

#include <stdbool.h>
#include <stdint.h>

#include "metanode/build.h"
#include "sketch.h"
#include "table.h"

#define MNI_WHITE UINT32_MAX /* RGBA8 of a vertex that has no colour */

enum { MNI_WELD_BATCH = 32 }; /* as many cache misses as a core can have on their way, and more */

typedef struct mni_weld_pending {
    double position[3];
    uint64_t hash, target;
    uint32_t rgba;
} mni_weld_pending;

typedef struct mni_weld {
    bool apart;        /* nothing is welded, and *target is not written */
    bool counting;     /* nothing is kept any more either */
    uint64_t vertices; /* kept apart so far */
    uint64_t nonfinite;
    double *position; /* 3 × vertices; that of a non-finite one has NaN for its x */
    uint32_t *color;  /* vertices, or NULL until the first coloured one */
    uint64_t capacity;
    mni_table table; /* of finite vertices, by position */
    uint64_t table_capacity;
    uint32_t **target; /* the caller's array, which may move between calls */
    uint64_t seed;
    mni_sketch sketch; /* of what came, while counting */
    uint32_t pending_count;
    mni_weld_pending pending[MNI_WELD_BATCH];
} mni_weld;

/* -0 becomes 0, so that equal positions have equal bytes; what floats cannot hold becomes NaN, 0,
 * 0: false. */
bool mni_weld_normalise(double position[3]);
void mni_weld_open(mni_weld *weld, bool apart, uint32_t **target);
/* Makes room for so many vertices, before the first. Here and below false: no memory. */
bool mni_weld_reserve(mni_weld *weld, uint64_t vertices);
/* Coordinates may be anything; those that floats cannot hold make a vertex non-finite. */
bool mni_weld_add(mni_weld *weld, const double position[3], uint32_t rgba, uint64_t target);
bool mni_weld_flush(mni_weld *weld);
/* Frees all that is kept; from here on vertices are only counted. */
void mni_weld_count_only(mni_weld *weld);
/* Kept apart so far, without those that wait; while counting, at most a few percent more. */
uint64_t mni_weld_vertices(const mni_weld *weld);
void mni_weld_close_table(mni_weld *weld); /* after the last vertex: only the arrays stay */
void mni_weld_close(mni_weld *weld);
/* Bytes of the table for so many vertices; reserved, or grown step by step. */
uint64_t mni_weld_table_bytes(uint64_t vertices, bool reserved);
/* Vertices at different positions; by the key that `key` makes of a position, of key_bytes. Takes
 * a table for as many while it counts. */
typedef void (*mni_weld_key)(const double position[3], const void *context, void *key);
bool mni_weld_count_places(const mni_weld *weld, mni_weld_key key, const void *context,
                           size_t key_bytes, uint64_t *places);

#endif
