/* What the steps of order.c share. */
#ifndef MNI_ORDER_PARTS_H
#define MNI_ORDER_PARTS_H

#include "buckets.h"
#include "order.h"
#include "pages.h"
#include "varint.h"
#include "watch.h"

/* How work_bytes is divided. Buckets are of 2^bits collapses, or of as many rows. */
typedef struct mni_order_plan {
    uint32_t bits, buckets, chunk_bytes;
    uint32_t threads;        /* 1, or 2: a bucket in each, so two of them in memory */
    uint64_t dealt_bytes;    /* rows, simplices, order ids: all the time */
    uint64_t nodes_bytes;    /* step 1, its sort apart */
    uint64_t sort_bytes;     /* step 1 */
    uint64_t rows_bytes;     /* steps 2 and 3, all of it */
    uint64_t vertices_bytes; /* of these: pages of vertices */
    uint64_t leaves_bytes;   /* and of the table of leaves */
    uint32_t simplices_at_once;
} mni_order_plan;

typedef struct mni_order_work {
    mni_history *history;
    mni_extmesh *mesh;
    const mni_order_desc *desc;
    mni_order_plan plan;
    mni_arena arena;                   /* of the buckets */
    mni_buckets row, simplex, ordered; /* by row */
    mni_spill leaf_of, counts;         /* a leaf's number by id; simplices of rows, a byte each */
    mni_spill places;                  /* of pages in the file, a u64 each */
    mni_ordered *out;
    mn_status *st;
} mni_order_work;

/* A row as it is dealt, at most MNI_BUCKET_RECORD_MAX bytes: 16 bits of its row; then
 *
 *   left leaves, 0: only the leaf before it is told of, whose id follows
 *   left split, or, where there is one leaf, its id; the same of the right
 *   switch value, radius, cone     7 bytes
 *   simplices
 *
 * A simplex: 16 bits of its row, which of the row's it is, ids as in history.c. First ids, and
 * leaves', are folded differences to the one before in the chunk. */
enum {
    MNI_ORDER_FACTS_BYTES = 7,
    MNI_ORDER_BUFFER_BYTES = 64 << 10,
    MNI_ORDER_PLACES_BYTES = 4096
};

static inline unsigned char *mni_order_put_id(unsigned char *to, uint32_t id, uint32_t *last) {
    to = mni_varint_put(to, mni_fold(id, *last));
    *last = id;
    return to;
}
static inline uint32_t mni_order_get_id(const unsigned char **from, uint32_t *last) {
    return *last = mni_unfold(mni_varint_get(from), *last);
}

/* Step 1: the history backwards, collapses dealt as rows. */
mn_code mni_order_nodes(mni_order_work *w);
/* Steps 2 and 3: rows in order, then their simplices. */
mn_code mni_order_rows(mni_order_work *w);

static inline mn_code mni_order_tell(mni_order_work *w, uint64_t done) {
    uint64_t total = 3 * (uint64_t)w->mesh->vertices;
    return mni_watch(w->desc->watch, "order", done, total, w->st);
}

#endif
