/* The edges of triangles that come in the order of their smallest vertices, counted in one sweep:
 * see extintake.h. An edge belongs to the smaller of its ends, and is complete when the sweep has
 * passed that vertex:
 *
 *     triangle a < b < c at a:   ab, ac   belong here
 *                                bc       waits for b, in a heap
 *
 * Vertices near each other have near numbers, so that few edges wait at a time: hundreds of
 * thousands for the globe of 18,653,760 triangles. What the heap has no room for, and all edges of
 * a vertex with too many, goes to a sort, and is looked at after the sweep. One edge of a vertex
 * there means all of them: a bit says so, shared by vertices with the same hash, since too many
 * there do no harm.
 *
 * Of the triangles that use a directed edge, all but the input's first are misoriented; a triangle
 * that is so at several edges counts once, hence the sort of their numbers.
 *
 * Secret: the heap. Memory: shares of work_bytes, for it and two sorts. One thread at a time.
 * (design.md §3.1) */
#include "extintake.h"

#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "noise.h"
#include "reader.h"

enum {
    GROUP_MAX = 64,  /* edges of one vertex that are sorted here; most have three */
    LATE_SHARE = 16, /* of the heap's memory: the bits */
};

typedef struct waiting {
    uint32_t smaller;
    uint32_t end;      /* larger vertex << 1 | runs from larger to smaller */
    uint32_t triangle; /* its number */
} waiting;

typedef struct edge { /* in the sort */
    uint64_t ends;    /* smaller << 32 | end */
    uint32_t triangle;
} __attribute__((packed, aligned(4))) edge;

struct mni_ext_edges {
    waiting *heap; /* by smaller */
    uint32_t count, max;
    uint64_t *late; /* bits */
    uint64_t late_bits;
    uint32_t vertex; /* whose edges are in the group */
    uint32_t group_count;
    bool heavy; /* it has too many: they are in the sort */
    waiting group[GROUP_MAX];
    mni_sort *sort, *flags; /* edges; numbers of misoriented triangles */
    /* the edge that is going by */
    uint64_t ends, uses, straight; /* uses: triangles; straight: from the smaller vertex */
    uint32_t first;                /* triangle that uses this directed edge */
};

/* For the disk: smaller - the last one's, end - twice the smaller, triangle's difference. */
static unsigned char *pack(const void *context, unsigned char *to, const void *record,
                           const void *before) {
    const edge *e = record, *b = before;
    const uint64_t smaller = e->ends >> 32;
    (void)context;
    to = mni_varint_put(to, smaller - (b->ends >> 32));
    to = mni_varint_put(to, (uint32_t)e->ends - 2 * smaller);
    return mni_varint_put(to, mni_fold(e->triangle, b->triangle));
}

static const unsigned char *unpack(const void *context, const unsigned char *from, void *record) {
    edge *e = record;
    (void)context;
    const uint64_t smaller = (e->ends >> 32) + mni_varint_get(&from);
    e->ends = smaller << 32 | (2 * smaller + mni_varint_get(&from));
    e->triangle = mni_unfold(mni_varint_get(&from), e->triangle);
    return from;
}

bool mni_ext_edges_open(mni_extintake *x) {
    static const mni_sort_packing packing = {3 * MNI_VARINT32_MAX, pack, unpack, NULL};
    uint64_t bytes = mni_ext_share(x, MNI_EXT_EDGES_SHARE) - sizeof *x->edges;
    uint64_t words = bytes / LATE_SHARE / sizeof(uint64_t);
    mni_ext_edges *e = x->edges = calloc(1, sizeof *e + bytes);
    if (e == NULL) {
        mn_fail(x->st, MN_FAILED, "%s: no memory", x->name);
        return false;
    }
    e->late = (uint64_t *)(void *)(e + 1);
    e->late_bits = 64 * words;
    e->heap = (waiting *)(void *)(e->late + words);
    e->max = (uint32_t)((bytes - words * sizeof(uint64_t)) / sizeof(waiting));
    const mni_sort_desc late = {.record_bytes = sizeof(edge),
                                .key = MNI_SORT_U64,
                                .packing = &packing,
                                .budget_bytes = mni_ext_share(x, MNI_EXT_LATE_SHARE)},
                        flags = {.record_bytes = sizeof(uint32_t),
                                 .key = MNI_SORT_U32,
                                 .budget_bytes = mni_ext_share(x, MNI_EXT_LATE_SHARE)};
    return mni_ext_sort_open(x, &e->sort, &late) && mni_ext_sort_open(x, &e->flags, &flags);
}

void mni_ext_edges_close(mni_extintake *x) {
    if (x->edges == NULL)
        return;
    mni_ext_sort_close(x, &x->edges->sort);
    mni_ext_sort_close(x, &x->edges->flags);
    free(x->edges);
    x->edges = NULL;
}

/* ---- counting, edge by edge ------------------------------------------------------------------ */

static void count_edge(mni_extintake *x) {
    const mni_ext_edges *e = x->edges;
    x->result.boundary_edges += e->uses == 1;
    x->result.nonmanifold_edges += e->uses > 2 || (e->uses == 2 && e->straight != 1);
}

/* All uses of an edge come one after the other, and of a directed one, too. */
static void see(mni_extintake *x, uint64_t ends, uint32_t triangle) {
    mni_ext_edges *e = x->edges;
    if (e->uses > 0 && ends >> 1 != e->ends >> 1) {
        count_edge(x);
        e->uses = e->straight = 0;
    }
    if (e->uses > 0 && ends == e->ends) {
        uint32_t later = triangle > e->first ? triangle : e->first;
        e->first = triangle > e->first ? e->first : triangle;
        mni_sort_put(e->flags, &later);
    } else {
        e->first = triangle;
    }
    e->ends = ends;
    e->uses++;
    e->straight += !(ends & 1);
}

static void see_late(mni_ext_edges *e, const waiting *w) {
    const edge late = {(uint64_t)w->smaller << 32 | w->end, w->triangle};
    mni_sort_put(e->sort, &late);
}

/* ---- a vertex's group ------------------------------------------------------------------------ */

static uint64_t late_bit(const mni_ext_edges *e, uint32_t vertex) {
    return mni_noise_mix(vertex) % e->late_bits;
}

static void add_to_group(mni_ext_edges *e, const waiting *w) {
    if (e->heavy) {
        see_late(e, w);
        return;
    }
    uint32_t at = e->group_count;
    if (at < GROUP_MAX) {
        while (at > 0 && e->group[at - 1].end > w->end) {
            e->group[at] = e->group[at - 1];
            at--;
        }
        e->group[at] = *w;
        e->group_count++;
        return;
    }
    for (uint32_t i = 0; i < e->group_count; i++)
        see_late(e, &e->group[i]);
    e->group_count = 0;
    e->heavy = true;
    see_late(e, w);
}

static void end_group(mni_extintake *x) {
    mni_ext_edges *e = x->edges;
    for (uint32_t i = 0; i < e->group_count; i++)
        see(x, (uint64_t)e->vertex << 32 | e->group[i].end, e->group[i].triangle);
    e->group_count = 0;
}

static void begin_group(mni_ext_edges *e, uint32_t vertex) {
    uint64_t bit = late_bit(e, vertex);
    e->vertex = vertex;
    e->heavy = e->late[bit / 64] >> bit % 64 & 1;
}

/* ---- the heap -------------------------------------------------------------------------------- */

static void push(mni_ext_edges *e, const waiting *w) {
    if (e->count == e->max) {
        uint64_t bit = late_bit(e, w->smaller);
        e->late[bit / 64] |= UINT64_C(1) << bit % 64;
        see_late(e, w);
        return;
    }
    uint32_t at = e->count++;
    for (; at > 0 && e->heap[(at - 1) / 2].smaller > w->smaller; at = (at - 1) / 2)
        e->heap[at] = e->heap[(at - 1) / 2];
    e->heap[at] = *w;
}

static waiting pop(mni_ext_edges *e) {
    waiting top = e->heap[0], last = e->heap[--e->count];
    uint32_t at = 0;
    for (;;) {
        uint32_t child = 2 * at + 1;
        child += child + 1 < e->count && e->heap[child + 1].smaller < e->heap[child].smaller;
        if (child >= e->count || e->heap[child].smaller >= last.smaller)
            break;
        e->heap[at] = e->heap[child];
        at = child;
    }
    e->heap[at] = last;
    return top;
}

/* ---- the sweep ------------------------------------------------------------------------------- */

/* The groups of all vertices below this one are complete; its own is begun. */
static void move_to(mni_extintake *x, uint64_t vertex) {
    mni_ext_edges *e = x->edges;
    while (e->count > 0 && e->heap[0].smaller <= vertex) {
        waiting w = pop(e);
        if (w.smaller != e->vertex) {
            end_group(x);
            begin_group(e, w.smaller);
        }
        add_to_group(e, &w);
    }
    if (vertex != e->vertex) {
        end_group(x);
        begin_group(e, (uint32_t)vertex);
    }
}

void mni_ext_edges_add(mni_extintake *x, const mni_exttriangle *t, uint32_t number) {
    waiting w[3];
    const uint32_t smallest = t->corner[0];
    for (int i = 0; i < 3; i++) {
        uint32_t a = t->corner[i], b = t->corner[(i + 1) % 3];
        w[i] = (waiting){a < b ? a : b, (a < b ? b : a) << 1 | (a > b), number};
    }
    if (smallest != x->edges->vertex)
        move_to(x, smallest);
    for (int i = 0; i < 3; i++)
        if (w[i].smaller == smallest)
            add_to_group(x->edges, &w[i]);
        else
            push(x->edges, &w[i]);
}

/* Different ones among the flags. */
static bool count_flags(mni_extintake *x) {
    const uint32_t *flag;
    uint64_t before = UINT64_MAX;
    if (mni_sort_finish(x->edges->flags, x->st) != MN_OK)
        return false;
    while ((flag = mni_sort_next(x->edges->flags, x->st)) != NULL) {
        x->counts.misoriented_faces += *flag != before;
        before = *flag;
    }
    return x->st->code == MN_OK;
}

bool mni_ext_edges_finish(mni_extintake *x) {
    mni_ext_edges *e = x->edges;
    const edge *late;
    move_to(x, UINT32_MAX); /* past all vertices */
    if (mni_sort_finish(e->sort, x->st) != MN_OK)
        return false;
    while ((late = mni_sort_next(e->sort, x->st)) != NULL)
        see(x, late->ends, late->triangle);
    if (x->st->code != MN_OK)
        return false;
    if (e->uses > 0)
        count_edge(x);
    return count_flags(x);
}
