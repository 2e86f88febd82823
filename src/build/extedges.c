/* The edges of triangles that come in the order of their smallest vertices, counted in one sweep:
 * see extintake.h. An edge belongs to the smaller of its ends, and is complete when the sweep has
 * passed that vertex:
 *
 *     triangle a < b < c at a:   ab, ac   belong here
 *                                bc       waits for b
 *
 * Who waits stands in a list: of b itself where the sweep is in b's range of vertices, else of that
 * range, whose edges are handed to their vertices when the sweep comes there. With as many ranges
 * as a range has vertices both tables are short, and nothing is compared.
 *
 *     ranges      [ done | now |  ·  |  ·  ]──► edge ──► edge
 *     vertices of now  [ · · ▲ · · · ]──► edge ──► edge
 *
 * Vertices near each other have near numbers, so that few edges wait at a time: hundreds of
 * thousands for the globe of 18,653,760 triangles. What there is no room for, and all edges of
 * a vertex with too many, goes to a sort, and is looked at after the sweep. One edge of a vertex
 * there means all of them: a bit says so, shared by vertices with the same hash, since too many
 * there do no harm.
 *
 * Of the triangles that use a directed edge, all but the input's first are misoriented; a triangle
 * that is so at several edges counts once, hence the sort of their numbers.
 *
 * Secret: the lists. Memory: shares of work_bytes, for them and two sorts. One thread at a time.
 * (design.md §3.1) */
#include "extintake.h"

#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "noise.h"
#include "reader.h"

enum {
    GROUP_MAX = 64,  /* edges of one vertex that are sorted here; most have three */
    LATE_SHARE = 16, /* of the lists' memory: the bits */
};

typedef struct waiting {
    uint32_t smaller;
    uint32_t end;      /* larger vertex << 1 | runs from larger to smaller */
    uint32_t triangle; /* its number */
    uint32_t next;     /* of its list; MN_NONE: the last */
} waiting;

typedef struct edge { /* in the sort */
    uint64_t ends;    /* smaller << 32 | end */
    uint32_t triangle;
} __attribute__((packed, aligned(4))) edge;

struct mni_ext_edges {
    waiting *edge;
    uint32_t used, max;                                /* of them; used: ever */
    uint32_t unused;                                   /* the first of those that wait no more */
    uint32_t *at_vertex, *in_range, range_bits, range; /* the range that the sweep is in */
    uint64_t *late;                                    /* bits */
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
    const uint64_t bytes = mni_ext_share(x, MNI_EXT_EDGES_SHARE) - sizeof *x->edges,
                   words = bytes / LATE_SHARE / sizeof(uint64_t);
    uint32_t bits = 0;
    while (x->result.vertices >> 2 * bits > 0)
        bits++;
    const uint64_t tables = (UINT64_C(1) << bits) + (x->result.vertices >> bits) + 1;
    MN_ASSERT(words * sizeof(uint64_t) + tables * sizeof(uint32_t) < bytes);
    mni_ext_edges *e = x->edges = calloc(1, sizeof *e + bytes);
    if (e == NULL) {
        mn_fail(x->st, MN_FAILED, "%s: no memory", x->name);
        return false;
    }
    e->late = (uint64_t *)(void *)(e + 1);
    e->late_bits = 64 * words;
    e->at_vertex = (uint32_t *)(void *)(e->late + words);
    e->in_range = e->at_vertex + (UINT64_C(1) << bits);
    e->edge = (waiting *)(void *)(e->at_vertex + tables);
    e->max = (uint32_t)((bytes - words * sizeof(uint64_t) - tables * sizeof(uint32_t)) /
                        sizeof(waiting));
    e->unused = MN_NONE;
    e->range_bits = bits;
    memset(e->at_vertex, 0xff, tables * sizeof(uint32_t));
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

/* ---- who waits ------------------------------------------------------------------------------- */

/* Where the list begins that an edge of that vertex waits in. */
static uint32_t *list_of(mni_ext_edges *e, uint32_t vertex) {
    const uint32_t range = vertex >> e->range_bits;
    return range == e->range ? &e->at_vertex[vertex - (range << e->range_bits)]
                             : &e->in_range[range];
}

static void push(mni_ext_edges *e, const waiting *w) {
    uint32_t at = e->unused, *list = list_of(e, w->smaller);
    if (at != MN_NONE) {
        e->unused = e->edge[at].next;
    } else if (e->used < e->max) {
        at = e->used++;
    } else {
        uint64_t bit = late_bit(e, w->smaller);
        e->late[bit / 64] |= UINT64_C(1) << bit % 64;
        see_late(e, w);
        return;
    }
    e->edge[at] = *w;
    e->edge[at].next = *list;
    *list = at;
}

/* Takes the first of a list that is not empty. */
static uint32_t pop(mni_ext_edges *e, uint32_t *list) {
    const uint32_t at = *list;
    *list = e->edge[at].next;
    return at;
}

static void enter_range(mni_ext_edges *e, uint32_t range) {
    e->range = range;
    while (e->in_range[range] != MN_NONE) {
        const uint32_t at = pop(e, &e->in_range[range]);
        uint32_t *list = list_of(e, e->edge[at].smaller);
        e->edge[at].next = *list;
        *list = at;
    }
}

/* ---- the sweep ------------------------------------------------------------------------------- */

/* From the vertex at hand, which is complete, to that one: its group is begun. */
static void move_to(mni_extintake *x, uint32_t vertex) {
    mni_ext_edges *e = x->edges;
    while (e->vertex < vertex) {
        end_group(x);
        begin_group(e, e->vertex + 1);
        if (e->vertex >> e->range_bits != e->range)
            enter_range(e, e->vertex >> e->range_bits);
        uint32_t *list = list_of(e, e->vertex);
        while (*list != MN_NONE) {
            const uint32_t at = pop(e, list);
            add_to_group(e, &e->edge[at]);
            e->edge[at].next = e->unused;
            e->unused = at;
        }
    }
}

void mni_ext_edges_add(mni_extintake *x, const mni_exttriangle *t, uint32_t number) {
    waiting w[3];
    const uint32_t smallest = t->corner[0];
    for (int i = 0; i < 3; i++) {
        uint32_t a = t->corner[i], b = t->corner[(i + 1) % 3];
        w[i] = (waiting){a < b ? a : b, (a < b ? b : a) << 1 | (a > b), number, MN_NONE};
    }
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
    move_to(x, (uint32_t)x->result.vertices); /* past all of them */
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
