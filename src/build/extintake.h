/* The intake of meshes larger than memory, between its files: extintake.c takes what readers push
 * and keeps the order of the steps, extnumber.c numbers vertices, extfaces.c judges triangles,
 * extedges.c counts edges, extvertices.c writes vertices.
 *
 *   pushed: vertices as they came       buckets: triangles by ranges of vertices
 *          │ sort by place                      │
 *          ▼                                    ▼
 *   placed: one a place ──── map ───► triangles of places' numbers
 *          │                                    │ reject, sort by corners, reject twins
 *          ▼                                    ▼
 *   used ones, on the grid: vertex       triangle ──► edges, swept: counts
 *
 * What lies on the disk is packed as differences of neighbours (varint.h), but for `vertex`, of
 * which single ones are asked for: 5 to 12 bytes a vertex or triangle, each way, where the structs
 * have 12 to 36.
 *
 * Memory, in 32nds of work_bytes (50 kB of structs apart):
 *
 *                    vertices sorted   handed out   triangles sorted   handed out   vertices
 *   buffers                2               2               2               2            2
 *   of buckets             1               1               1               1
 *   map                                   21          21, or 12 ¹
 *   the sort              28               8             what is left      8         2 × 8
 *   a bit a place                                          4               4            4
 *   edges                                                             8 + 4 + 4
 *
 *   ¹ of all vertices, or of a bucket's
 *
 * Every bool: false means that the status has been filled. One thread, and with two allowed another
 * that sorts what is read (extnumber.c), judges triangles and counts edges while they are handed
 * out (extfaces.c), and one that writes vertices meanwhile (extvertices.c). */
#ifndef MNI_EXTINTAKE_H
#define MNI_EXTINTAKE_H

#include <stdatomic.h>

#include "extmesh.h"
#include "extsort.h"
#include "mem.h"
#include "relay.h"
#include "varint.h"
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

/* Shares, as in the table above. */
enum {
    MNI_EXT_SHARES = 32,
    MNI_EXT_BUFFERS_SHARE = 2,
    MNI_EXT_BUCKETS_SHARE = 1,
    MNI_EXT_MAP_SHARE = 21, /* of all vertices */
    MNI_EXT_MAP_PART_SHARE = 12,
    MNI_EXT_SORT_SHARE = 28, /* of vertices, and from then on: */
    MNI_EXT_AFTER_SHARE = 8, /* what hands out */
    MNI_EXT_USED_SHARE = 4,  /* a bit a place */
    MNI_EXT_EDGES_SHARE = 8, /* those that wait; what has no room there: */
    MNI_EXT_LATE_SHARE = 4,  /* the sort, and as much for the flags */
};

/* A vertex as it came, or a place. */
typedef struct mni_ext_vertex {
    double position[3];
    uint32_t rgba;
} mni_ext_vertex;

/* Its words: position, rgba. Narrow ones are those that floats hold; the first that they do not,
 * and all that come after it, are wide. So are all places, if one vertex is. */
enum { MNI_EXT_NARROW_WORDS = 3 + 1, MNI_EXT_WIDE_WORDS = 6 + 1 };
typedef struct mni_ext_words {
    uint32_t word[MNI_EXT_WIDE_WORDS];
} mni_ext_words;
static inline uint32_t mni_ext_count(bool wide) {
    return wide ? MNI_EXT_WIDE_WORDS : MNI_EXT_NARROW_WORDS;
}
static inline mni_ext_words mni_ext_words_of(const mni_ext_vertex *v, bool wide) {
    const double *p = v->position;
    const float narrow[3] = {(float)p[0], (float)p[1], (float)p[2]};
    mni_ext_words w = {0};
    memcpy(w.word, wide ? (const void *)p : narrow, wide ? 3 * sizeof *p : sizeof narrow);
    w.word[mni_ext_count(wide) - 1] = v->rgba;
    return w;
}
static inline mni_ext_vertex mni_ext_vertex_of(const uint32_t *word, bool wide) {
    mni_ext_vertex v = {.rgba = word[mni_ext_count(wide) - 1]};
    float narrow[3];
    memcpy(narrow, word, sizeof narrow);
    memcpy(v.position, word, sizeof v.position * wide);
    for (int i = 0; i < 3 && !wide; i++)
        v.position[i] = narrow[i];
    return v;
}

static inline bool mni_ext_is_float(double x) {
    return (double)(float)x == x;
}

/* Where positions are counted from, for a box, and its grid. */
typedef struct mni_ext_frame {
    double origin[3];
    float low[3], high[3]; /* of the box, from there */
    float step;            /* of mni_ext_curve_bits */
} mni_ext_frame;

/* A range of `window` vertices: what refers to them, one piece of the file behind the other. */
typedef struct mni_ext_bucket {
    mni_spill
        spill; /* triangles and lone corners; pairs of vertex and place; the corners' places */
    uint64_t pairs, found; /* where the second and third begin */
    mni_spill_writer to;
    mni_spill_reader from;
    uint32_t last[2]; /* numbers that were packed, or unpacked, last */
    unsigned char *buffer;
} mni_ext_bucket;

/* Vertices on their way to what is kept: the writing thread's, from begin to finish. */
typedef struct mni_ext_writing {
    /* const while it writes */
    mni_ext_frame frame;
    bool moved, sorts;
    bool beside, open;        /* in a thread of its own, which is there */
    mni_sort *before, *after; /* numbers of positions, as they came and as they are kept; or NULL */
    /* its own */
    uint64_t runs; /* of equal positions, one after the other */
    mni_relay relay;
    uint64_t batch[MNI_RELAY_BATCHES]; /* the relay's: one record says that all may be written */
    atomic_bool stop;                  /* the caller's: it is not wanted any more */
} mni_ext_writing;

/* Vertices that are sorted while triangles come, in a thread of its own: from begin to end, or to
 * stop. */
typedef struct mni_ext_sorting {
    bool open; /* it is there */
    mni_relay relay;
    uint64_t batch[MNI_RELAY_BATCHES]; /* the relay's: one record says that all may be sorted */
    mni_sort *sort;                    /* the thread's, and what follows */
    mni_sort_packing packing;          /* the sort's */
    mni_spill from;                    /* a copy of x->pushed: a spill has one thread */
    mn_status st;
    atomic_uint_fast64_t sorted; /* vertices so far */
    atomic_bool over;            /* the thread's last word */
    atomic_bool stop;            /* the caller's: it is not wanted any more */
} mni_ext_sorting;

struct mni_extintake {
    /* const after open */
    mni_extmesh_desc desc;
    bool apart, soup;
    const char *name;
    mn_status *st;
    mni_arena arena; /* the buffers */
    unsigned char *buffer[MNI_EXT_BUFFERS];
    size_t buffer_bytes; /* each */
    size_t bucket_bytes; /* of a bucket's buffer */

    /* while vertices and triangles come */
    uint64_t vertices, triangles; /* pushed; triangles without MN_NONE */
    uint64_t nonfinite, narrow_vertices;
    bool has_colors;
    double low[3], high[3]; /* of finite vertices */
    mni_spill pushed;
    mni_spill_writer to_pushed;
    mni_ext_words last; /* pushed */
    uint64_t window;    /* vertices of a bucket; 0: not chosen yet */
    mni_ext_bucket bucket[MNI_EXT_BUCKETS];
    mni_spill sequence; /* triangles in several buckets: number, and the bucket of each corner */
    mni_spill_writer to_sequence;
    uint32_t last_in_sequence;

    mni_ext_sorting sorting;

    /* numbering */
    mni_ext_frame frame; /* of all finite ones: what the curve follows */
    uint64_t places;     /* different finite positions: numbers 0 … places - 1 */
    mni_spill placed;    /* points, by place */
    uint32_t *map;       /* of all vertices, or one bucket's: their places, or MN_NONE */
    uint64_t map_bytes;

    /* triangles */
    uint64_t *used;        /* a bit a place */
    uint32_t *used_before; /* for each MNI_EXT_RANK_WORDS words of them */
    uint64_t judged;       /* so far, or on their way to it */
    mni_relay judge;
    bool judging; /* the relay is open */
    mni_sort *triangle_sort;
    mni_ext_edges *edges;

    mni_ext_writing writing;

    mn_intake counts;
    mni_extmesh result;
};

enum { MNI_EXT_RANK_WORDS = 8 };

static inline bool mni_ext_is_wide(const mni_extintake *x) {
    return x->narrow_vertices < x->vertices;
}

static inline uint64_t mni_ext_share(const mni_extintake *x, uint32_t share) {
    return x->desc.work_bytes / MNI_EXT_SHARES * share;
}

/* The next vertex of a spill; last: the words of the one before, 0 at first. */
static inline bool mni_ext_next(mni_spill_reader *r, mni_ext_words *last, bool wide,
                                mni_ext_vertex *out) {
    const unsigned char *at = mni_spill_peek(r, MNI_EXT_WIDE_WORDS * MNI_VARINT32_MAX);
    if (at == NULL)
        return false;
    mni_spill_skip(r, mni_words_get(at, last->word, mni_ext_count(wide)));
    *out = mni_ext_vertex_of(last->word, wide);
    return true;
}
static inline void mni_ext_put(mni_spill_writer *w, mni_ext_words *last, bool wide,
                               const mni_ext_vertex *v) {
    const mni_ext_words now = mni_ext_words_of(v, wide);
    unsigned char packed[MNI_EXT_WIDE_WORDS * MNI_VARINT32_MAX];
    unsigned char *end = mni_words_put(packed, now.word, last->word, mni_ext_count(wide));
    mni_spill_put(w, packed, (size_t)(end - packed));
    memcpy(last->word, now.word, mni_ext_count(wide) * sizeof *now.word);
}

/* How far numbering vertices has come, and triangles by their numbers; each goes over them twice.
 */
static inline bool mni_ext_tell_vertices(const mni_extintake *x, uint64_t done) {
    return mni_watch_each(&x->desc.watch, "number", done, 2 * x->vertices, x->st) == MN_OK;
}
static inline bool mni_ext_tell_triangles(const mni_extintake *x, uint64_t done) {
    return mni_watch_each(&x->desc.watch, "check", done, 2 * x->triangles, x->st) == MN_OK;
}

/* desc: without a folder; its budgets are raised to the least that works. */
bool mni_ext_sort_open(mni_extintake *x, mni_sort **sort, const mni_sort_desc *desc);
/* Adds up what it moved, and closes it. */
void mni_ext_sort_close(mni_extintake *x, mni_sort **sort);
/* Buckets that the vertices fall into; at least one. */
static inline uint64_t mni_ext_buckets(const mni_extintake *x) {
    return x->vertices == 0 ? 1 : (x->vertices + x->window - 1) / x->window;
}
/* The bucket's writer, made with the first use; NULL: trouble. */
mni_spill_writer *mni_ext_bucket_writer(mni_extintake *x, uint64_t bucket);
bool mni_ext_spill_open(mni_extintake *x, mni_spill *spill);
void mni_ext_spill_close(mni_extintake *x, mni_spill *spill);
/* The spill's failure, if there is one, becomes the intake's. */
bool mni_ext_spill_good(mni_extintake *x, const mni_spill *spill);

/* A triangle in a bucket, or a corner of one that lies in several. */
typedef struct mni_ext_item {
    bool lone;
    uint32_t number, corner[3]; /* lone: only corner[0] */
} mni_ext_item;
enum { MNI_EXT_ITEM_MAX = 4 * MNI_VARINT32_MAX };
/* last: of this bucket's numbers and corners. */
const unsigned char *mni_ext_item_get(const unsigned char *from, mni_ext_item *item,
                                      uint32_t last[2]);

/* With the first triangle, when most likely all vertices have come, and two threads allowed: begins
 * to sort them. */
bool mni_ext_sorting_begin(mni_extintake *x);
/* For nothing: another vertex has come, or it is the end. Harmless where none has begun. */
void mni_ext_sorting_stop(mni_extintake *x);
/* Places for all vertices, and the map. */
bool mni_ext_place_vertices(mni_extintake *x);
/* Triangles by places: opens the faces and has each judged. */
bool mni_ext_place_triangles(mni_extintake *x);
bool mni_ext_faces_open(mni_extintake *x);
/* A triangle of places, or with MN_NONE; number: in the input. In any order. What is found is not
 * looked at before the end, which is harmless where faces are not open. */
bool mni_ext_judge(mni_extintake *x, const uint32_t place[3], uint32_t number);
void mni_ext_judge_end(mni_extintake *x);
/* All have been judged: which places are used is known, and told by mni_ext_is_used. */
bool mni_ext_faces_judged(mni_extintake *x);
/* Twins go, the rest is written. */
bool mni_ext_faces_finish(mni_extintake *x);
static inline bool mni_ext_is_used(const mni_extintake *x, uint64_t place) {
    return x->used[place / 64] >> place % 64 & 1;
}
/* Edges of the triangles that are kept, in their order, and what is counted of them. */
bool mni_ext_edges_open(mni_extintake *x);
void mni_ext_edges_add(mni_extintake *x, const mni_exttriangle *t, uint32_t number);
bool mni_ext_edges_finish(mni_extintake *x);
void mni_ext_edges_close(mni_extintake *x);
/* Bits of a side of the grid that the curve follows; a finer one shares its cells. */
enum { MNI_EXT_CURVE_BITS_MAX = 20 };
static inline uint32_t mni_ext_curve_bits(const mni_extintake *x) {
    const uint32_t bits = x->desc.position_bits > 0 ? x->desc.position_bits : MN_POSITION_BITS;
    return bits < MNI_EXT_CURVE_BITS_MAX ? bits : MNI_EXT_CURVE_BITS_MAX;
}
/* exact: floats hold all positions. */
mni_ext_frame mni_ext_frame_of(const mni_extintake *x, const double low[3], const double high[3],
                               bool exact);
/* A coordinate from the origin, as it is rounded for all. */
static inline float mni_ext_from_origin(const mni_ext_frame *f, double p, int axis) {
    return (float)(p - f->origin[axis]) + 0.0f;
}
/* The places that triangles use, once it is known which these are: begins, perhaps beside what
 * the caller goes on with; is done when finish returns. stop: of one that is not to be finished;
 * harmless on one that has not begun. */
bool mni_ext_vertices_begin(mni_extintake *x);
bool mni_ext_vertices_finish(mni_extintake *x);
void mni_ext_vertices_stop(mni_extintake *x);

#endif
