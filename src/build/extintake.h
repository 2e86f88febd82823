/* The intake of meshes larger than memory, between its files: extintake.c takes what readers push
 * and keeps the order of the steps, extnumber.c numbers vertices, extfaces.c judges triangles,
 * extedges.c counts edges.
 *
 *   pushed ─► narrow, wide: vertices as they came      buckets: corners, by ranges of vertices
 *                    │ sort by place                      │
 *                    ▼                                    ▼
 *              placed: one vertex a place ── map ──► corners by their places' numbers
 *                                                         │ reject, sort by corners, reject twins
 *                                                         ▼
 *              used ones only ──► vertex              triangle ──► edges, swept: counts
 *
 * Memory, in shares of work_bytes: the map of a bucket takes half, a sort a quarter (that of
 * vertices half, while there is no map), buffers of buckets a quarter until vertices have their
 * places, a bit (and a bit) a place an eighth, other buffers an eighth; 50 kB of structs apart.
 * Every bool: false means that the status has been filled. One thread. */
#ifndef MNI_EXTINTAKE_H
#define MNI_EXTINTAKE_H

#include "extmesh.h"
#include "extsort.h"
#include "mem.h"
#include "watch.h"

typedef struct mni_extintake mni_extintake;
typedef struct mni_ext_edges mni_ext_edges;

/* What a reader pushes; as mni_intake_…, which hand it on. */
mni_extintake *mni_extintake_open(const mni_extmesh_desc *desc, const mn_read_desc *read, bool soup,
                                  const char *name, mn_status *st);
bool mni_extintake_vertex(mni_extintake *x, const double position[3], uint32_t rgba);
/* MN_NONE for all: fewer than three corners. */
bool mni_extintake_triangle(mni_extintake *x, uint32_t a, uint32_t b, uint32_t c);
bool mni_extintake_finish(mni_extintake *x, mni_extmesh *out);
void mni_extintake_close(mni_extintake *x); /* NULL is allowed */

/* What would do for so many vertices. */
void mni_ext_too_small(mni_extintake *x, uint64_t vertices, uint64_t work_bytes);

/* ---- between the files ----------------------------------------------------------------------- */

enum { MNI_EXT_BUFFERS = 3, MNI_EXT_BUCKETS = 64 };

/* A range of `window` vertices: what refers to them, one piece of the file behind the other. */
typedef struct mni_ext_bucket {
    mni_spill spill; /* corners, in the input's order; pairs of vertex and place; the corners */
    uint64_t pairs, found; /* once more, by places: where these begin */
    mni_spill_writer to;
    mni_spill_reader from;
    unsigned char *buffer;
} mni_ext_bucket;

struct mni_extintake {
    /* const after open */
    mni_extmesh_desc desc;
    bool apart, soup;
    const char *name;
    mn_status *st;
    mni_arena arena; /* the buffers */
    unsigned char *buffer[MNI_EXT_BUFFERS];
    size_t buffer_bytes; /* each; a multiple of every record's size */

    /* while vertices and triangles come */
    uint64_t vertices, triangles; /* pushed; triangles without MN_NONE */
    uint64_t nonfinite, narrow_vertices;
    bool has_colors;
    double low[3], high[3]; /* of finite vertices */
    mni_spill narrow, wide; /* vertices: as long as floats hold them, and from then on */
    uint64_t window;        /* vertices of a bucket; const */
    size_t bucket_bytes;    /* of a bucket's buffer; const */
    mni_ext_bucket bucket[MNI_EXT_BUCKETS];
    mni_spill sequence;      /* a byte a corner: its bucket, from the first on that is not in 0 */
    uint64_t sequence_begin; /* corners before that one */
    mni_spill_writer to_narrow, to_wide, to_sequence;

    /* numbering */
    uint64_t places;  /* different finite positions: numbers 0 … places - 1 */
    mni_spill placed; /* by place: mni_extvertex, or mni_ext_wide where floats do not hold them */
    uint32_t *map;    /* of one bucket's vertices: their places, or MN_NONE */

    /* triangles */
    uint64_t *used;        /* a bit a place */
    uint32_t *used_before; /* for each MNI_EXT_RANK_WORDS words of them */
    mni_sort *triangle_sort;
    mni_ext_edges *edges;

    mn_intake counts;
    mni_extmesh result;
};

enum { MNI_EXT_RANK_WORDS = 8 };

/* A vertex as it came. */
typedef struct mni_ext_narrow {
    float position[3];
    uint32_t rgba;
} mni_ext_narrow;

/* The same, or a place, where coordinates are not all floats. */
typedef struct mni_ext_wide {
    double position[3];
    uint32_t rgba, zero;
} mni_ext_wide;

static inline bool mni_ext_is_wide(const mni_extintake *x) {
    return x->narrow_vertices < x->vertices;
}

/* How far numbering vertices has come, and triangles by their numbers; each goes over them twice.
 */
static inline bool mni_ext_tell_vertices(const mni_extintake *x, uint64_t done) {
    return mni_watch_each(&x->desc.watch, "number", done, 2 * x->vertices, x->st) == MN_OK;
}
static inline bool mni_ext_tell_triangles(const mni_extintake *x, uint64_t done) {
    return mni_watch_each(&x->desc.watch, "check", done, 2 * x->triangles, x->st) == MN_OK;
}

typedef enum mni_ext_share {
    MNI_EXT_HALF = 2,
    MNI_EXT_QUARTER = 4,
    MNI_EXT_EIGHTH = 8
} mni_ext_share;
bool mni_ext_sort_open(mni_extintake *x, mni_sort **sort, uint32_t record_bytes, mni_sort_key key,
                       mni_ext_share share);
/* Adds up what it moved, and closes it. */
void mni_ext_sort_close(mni_extintake *x, mni_sort **sort);
/* Buckets that the vertices fall into; at least one. */
static inline uint64_t mni_ext_buckets(const mni_extintake *x) {
    return x->vertices == 0 ? 1 : (x->vertices + x->window - 1) / x->window;
}
/* The bucket's, made with the first use. */
bool mni_ext_bucket_put(mni_extintake *x, uint64_t bucket, const void *bytes, size_t count);
bool mni_ext_spill_open(mni_extintake *x, mni_spill *spill);
void mni_ext_spill_close(mni_extintake *x, mni_spill *spill);
/* The spill's failure, if there is one, becomes the intake's. */
bool mni_ext_spill_good(mni_extintake *x, const mni_spill *spill);

/* Places for all vertices, and the map. */
bool mni_ext_place_vertices(mni_extintake *x);
/* Triangles in the input's order, by places: opens the faces and has each judged. */
bool mni_ext_place_triangles(mni_extintake *x);
bool mni_ext_faces_open(mni_extintake *x);
/* A triangle of places, or with MN_NONE; number: in the input. */
void mni_ext_judge(mni_extintake *x, const uint32_t place[3], uint32_t number);
/* Edges of the triangles that are kept, in their order, and what is counted of them. */
bool mni_ext_edges_open(mni_extintake *x);
void mni_ext_edges_add(mni_extintake *x, const mni_exttriangle *t, uint32_t number);
bool mni_ext_edges_finish(mni_extintake *x);
void mni_ext_edges_close(mni_extintake *x);
/* Twins go, the rest is written; then the vertices that it uses. */
bool mni_ext_faces_finish(mni_extintake *x);

#endif
