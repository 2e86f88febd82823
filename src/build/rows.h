/* A tree in rows, leaf by leaf: the form in which it stands in a .vdt and is cut into blocks.
 *
 * Row i holds leaf i, and the inner node whose right child begins with it (leaf_mid = i): a tree of
 * n leaves has n - 1 inner nodes, one for each leaf but the first. What is below a node is one run
 * of rows, and its simplices one run of theirs:
 *
 *     leaf          0   1   2   3   4   5            node of row 2: leaves [0, 6), its left child
 *     inner node    –   a   R   c   b   d            is row 1's, [0, 2), its right child row 4's,
 *                       └─2─┘   └─2─┴─2─┘            [2, 6). Row 0 has none: there a root begins
 *
 * So who works on a part of the model reads a part of the files. Nodes are called by their rows.
 *
 * Rows lie in memory, or in files, as they are or packed (rowpack.h), of which so many pages are
 * kept. Any number of threads may read;
 * calls on files block, and what they cannot read is told by mni_rows_trouble. Nothing read is to
 * be trusted before it was checked. Paper: §3.2. */
#ifndef MNI_ROWS_H
#define MNI_ROWS_H

#include "lock.h"
#include "metanode/build.h"

typedef struct mni_row {
    float position[3]; /* of the leaf */
    uint32_t rgba;     /* of the leaf; 0xffffffff in a model without colours */
    uint32_t order;    /* order id of the inner node; 0: there is none, and what follows is 0, but
                          for children that are MN_NONE and simplex_start */
    uint32_t leaf_lo, leaf_hi;
    uint32_t left, right; /* rows of its children; MN_NONE: a leaf */
    float switch_value, radius;
    uint32_t simplex_start; /* the first of its simplices; they end where the next row's start */
    mn_cone cone;
    uint8_t zero;
} mni_row;
_Static_assert(sizeof(mni_row) == 52, "no padding: rows are written as they are");

/* Three leaf ids in the input's cyclic order, turned so that the one outside the kill node comes
 * last. Of a hinge, that is MN_NONE. */
typedef struct mni_row_simplex {
    uint32_t corner[3];
} mni_row_simplex;

/* Where the rows and simplices of a tree are: in memory, or from those offsets of a file on. The
 * owner's, and must outlive what is opened on it. */
typedef struct mni_rows_source {
    uint32_t rows, simplices;
    bool has_colors;
    const mni_row *row; /* NULL: in files */
    const mni_row_simplex *simplex;
    int fd;
    uint64_t row_offset, simplex_offset;
    uint64_t places_offset; /* of where packed pages begin; 0: they are not packed */
    float grid_step;        /* for packed ones */
    const char *name;       /* of the file, for messages; NULL: it has none */
    uint64_t stamp;         /* the file's when it was opened; 0: nobody else has it */
} mni_rows_source;

/* Another whenever somebody has written to the file, or done something else to it; never 0. */
uint64_t mni_rows_stamp(int fd);

typedef struct mni_rows_slot {
    uint64_t page; /* its kind and number */
    uint32_t next; /* slot of the same bucket */
    bool recent;
} mni_rows_slot;

typedef struct mni_rows {
    mni_rows_source source; /* const after open */
    uint32_t slots, buckets;
    mni_lock lock;
    /* guarded by lock */
    mni_rows_slot *slot;
    unsigned char *bytes; /* of the slots' pages */
    uint32_t *bucket;
    uint32_t used, hand; /* slots filled so far; where the clock stands */
    uint64_t bytes_read;
    mn_status trouble; /* the first */
} mni_rows;

/* cache_bytes: of pages that are kept of files, their table included; too little is raised to the
 * least that works. MN_FAILED: no memory. */
mn_code mni_rows_open(mni_rows *rows, const mni_rows_source *source, uint64_t cache_bytes,
                      mn_status *st);
void mni_rows_close(mni_rows *rows); /* harmless on a zeroed one */
/* The first read that failed. */
mn_code mni_rows_trouble(mni_rows *rows, mn_status *st);

/* Row `at` and where its simplices end. false: not to be read. */
bool mni_rows_get(mni_rows *rows, uint32_t at, mni_row *row, uint32_t *simplex_end);
/* Copies rows, or simplices, [first, end). false: not to be read. */
bool mni_rows_copy(mni_rows *rows, bool simplices, uint32_t first, uint32_t end, void *out);
/* Simplices [first, first + count), in memory or copied to room. NULL: not to be read, or there
 * are none such. */
const mni_row_simplex *mni_rows_simplices(mni_rows *rows, uint32_t first, uint32_t count,
                                          mni_row_simplex *room);

/* A run of rows and its simplices. Zeroed before its first use; filled again, it keeps its
 * memory. */
typedef struct mni_rows_run {
    uint32_t first, end; /* rows */
    uint32_t simplex_first, simplex_end;
    const mni_row *row; /* [0] is row `first` */
    const mni_row_simplex *simplex;
    mni_row *row_room; /* own memory, for files */
    mni_row_simplex *simplex_room;
    uint32_t row_capacity, simplex_capacity;
} mni_rows_run;
/* Rows [first, end), their simplices where these are at most simplices_max and begin before they
 * end: otherwise simplex is NULL. false: not to be read, or no memory. */
bool mni_rows_fill_run(mni_rows *rows, uint32_t first, uint32_t end, uint32_t simplices_max,
                       mni_rows_run *run);
void mni_rows_run_free(mni_rows_run *run);

/* Some pages that a thread has copied for itself: who asks again and again for rows that are near
 * each other takes no lock for most of them. One thread's. */
enum { MNI_ROWS_NEAR_PAGES = 32, MNI_ROWS_NEAR_KINDS = 2 }; /* of rows, and of simplices */
typedef struct mni_rows_near {
    mni_rows *rows;
    unsigned char *bytes;                                    /* NULL: rows are in memory */
    uint32_t page[MNI_ROWS_NEAR_KINDS][MNI_ROWS_NEAR_PAGES]; /* by number; MN_NONE: none */
} mni_rows_near;
/* false: no memory. */
bool mni_rows_near_open(mni_rows_near *near, mni_rows *rows);
void mni_rows_near_close(mni_rows_near *near); /* harmless on a zeroed one */
/* As mni_rows_get and mni_rows_simplices. */
bool mni_rows_near_get(mni_rows_near *near, uint32_t at, mni_row *row, uint32_t *simplex_end);
const mni_row_simplex *mni_rows_near_simplices(mni_rows_near *near, uint32_t first, uint32_t count,
                                               mni_row_simplex *room);

#endif
