/* From a .mnt back to a tree, believing nothing.
 *
 * Hides: how blocks are followed and what is compared across them. Each block is read once, from
 * the roots down; what its parent says of a child (interval, position) and what the child repeats
 * of its parent must agree; every order id comes once; all that the header counts is counted again.
 *
 *     tasks:  [ block | the exits that lead to it ] …   a stack: a child's task lies above its
 * aunts' exits:  [ parent node, side, subtree ] …          a stack too: those of the top task on
 * top
 *
 * Order: mni_mnt_load alone. One thread; blocks on the disk. Memory: the tree, its simplices once
 * more, and two blocks. Paper: §3.2. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "block.h"
#include "extents.h"
#include "frame.h"
#include "header.h"
#include "tree.h"
#include "watch.h"

enum { WATCH_EVERY = 64 }; /* blocks */

typedef struct exit_record {
    uint32_t parent; /* inner index; MN_NONE: a root of the forest */
    uint32_t side;   /* 0 left, 1 right; of a root: its number */
    uint32_t ref, subtree;
    mni_facts facts; /* not of a root */
} exit_record;

typedef struct task {
    mn_block_ref place;
    uint32_t parent_id, depth;
    uint32_t exit_first, exits;
} task;

typedef struct loader {
    const char *path;
    mn_header header;
    mn_header found; /* the counts as they are in the blocks */
    mni_block_limits limits;
    mni_stored in;
    mn_tree *tree;
    mn_status *st;
    unsigned char *bytes, *overflow_bytes;
    unsigned char *loaded;   /* inner: seen */
    uint32_t *first, *count; /* inner: its simplices in corner */
    uint32_t *corner;        /* 3 × simplices, in the order of reading */
    uint32_t simplices;
    uint32_t *lo, *hi; /* of the block's nodes */
    task *task;
    uint32_t tasks, tasks_capacity;
    exit_record *exit;
    uint32_t exits, exits_capacity;
    uint64_t pages, payload_bytes;
    uint32_t root_order[MN_ROOTS_MAX];
} loader;

static uint64_t byte_of(const loader *l, uint32_t id) {
    return mni_extents_find(&l->in.extents, (mn_block_ref){id, 1}).offset;
}

#define BAD(l, id, format, ...)                                                                    \
    mn_fail((l)->st, MN_BAD_INPUT,                                                                 \
            "%s: block %u (at byte %llu): " format "; the file is damaged: build it again",        \
            (l)->path, id, (unsigned long long)byte_of(l, id), __VA_ARGS__)

static bool grow(void **array, uint32_t needed, uint32_t *capacity, size_t size) {
    if (needed <= *capacity)
        return true;
    uint32_t wanted = needed + needed / 2 + 64;
    void *bigger = realloc(*array, wanted * size);
    if (bigger == NULL)
        return false;
    *array = bigger;
    *capacity = wanted;
    return true;
}

static mn_code no_memory(loader *l) {
    return mn_fail(l->st, MN_FAILED, "%s: no memory for its %u nodes", l->path, l->header.nodes);
}

static mn_code read_block(loader *l, mn_block_ref place, unsigned char *bytes) {
    uint32_t length = place.pages * MN_PAGE_BYTES; /* in range: see where places are checked */
    int64_t got = mni_stored_read(&l->in, place, bytes);
    if (got == -EBADMSG)
        return BAD(l, place.id, "%s", "its extent is not that of a compressed block");
    if (got < 0)
        return mn_fail(l->st, MN_FAILED, "%s: block %u: cannot read: %s", l->path, place.id,
                       strerror((int)-got));
    if (got != length)
        return BAD(l, place.id, "only %lld of %u bytes are there", (long long)got, length);
    mni_frame_fault fault = mni_frame_check(bytes, place, l->header.build_id, l->header.file_bytes);
    if (fault != MNI_FRAME_OK)
        return BAD(l, place.id, "%s", mni_frame_fault_text(fault));
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    l->found.blocks++;
    l->pages += place.pages;
    l->payload_bytes += frame.payload_bytes;
    if (length > l->found.block_bytes_max)
        l->found.block_bytes_max = length;
    if (frame.refs > l->found.children_max)
        l->found.children_max = frame.refs;
    if (l->found.blocks > l->header.blocks)
        return BAD(l, place.id, "more than the %u blocks that the header counts", l->header.blocks);
    return MN_OK;
}

static bool place_ok(const loader *l, mn_block_ref place) {
    return place.pages <= l->header.block_bytes_max / MN_PAGE_BYTES;
}

/* ---- nodes and simplices -------------------------------------------------------------------- */

static mn_code add_simplex(loader *l, uint32_t id, const uint32_t corner[3]) {
    if (l->simplices == l->tree->simplices)
        return BAD(l, id, "more than the %u simplices that the header counts", l->simplices);
    memcpy(l->corner + 3 * (size_t)l->simplices++, corner, 3 * sizeof *corner);
    return MN_OK;
}

static mn_code load_overflow(loader *l, mn_block_ref place, uint32_t parent_id, uint32_t node) {
    const mn_tree *t = l->tree;
    mn_code code = MN_OK;
    uint32_t length = 0;
    for (bool more = true; more && code == MN_OK;) {
        mni_overflow view;
        mni_frame frame;
        char why[160];
        if (!place_ok(l, place))
            return BAD(l, place.id, "longer than the header's block_bytes_max (%u pages)",
                       place.pages);
        code = read_block(l, place, l->overflow_bytes);
        if (code != MN_OK)
            break;
        mni_frame_get(l->overflow_bytes, &frame);
        if (!mni_overflow_open(&view, l->overflow_bytes, place.pages * MN_PAGE_BYTES, &l->limits,
                               why, sizeof why))
            return BAD(l, place.id, "%s", why);
        if (view.order != t->leaves + node || view.leaf_lo != t->leaf_lo[node] ||
            view.leaf_mid != t->leaf_mid[node] || view.leaf_hi != t->leaf_hi[node] ||
            frame.parent_id != parent_id)
            return BAD(l, place.id, "overflow of node %u, not of %u", view.order, t->leaves + node);
        for (uint32_t i = 0; i < view.simplices && code == MN_OK; i++) {
            uint32_t corner[3];
            mni_overflow_simplex(&view, i, corner);
            code = add_simplex(l, place.id, corner);
        }
        length++;
        more = frame.refs > 0;
        parent_id = place.id;
        if (more)
            place = mni_frame_ref(l->overflow_bytes, 0);
    }
    if (length > l->found.overflow_max)
        l->found.overflow_max = length;
    return code;
}

/* What a child is called in the tree. */
static uint32_t child_order(loader *l, const mni_child *child, uint32_t lo, uint32_t hi) {
    if (child->kind == MNI_CHILD_LEAF)
        return lo;
    if (child->kind == MNI_CHILD_INNER) {
        l->lo[child->node] = lo;
        l->hi[child->node] = hi;
    }
    return child->facts.order;
}

static mn_code add_exit(loader *l, const mni_child *child, uint32_t parent, uint32_t side) {
    if (child->kind != MNI_CHILD_SUBTREE)
        return MN_OK;
    if (!grow((void **)&l->exit, l->exits + 1, &l->exits_capacity, sizeof *l->exit))
        return no_memory(l);
    l->exit[l->exits++] = (exit_record){parent, side, child->ref, child->subtree, child->facts};
    return MN_OK;
}

static mn_code load_node(loader *l, const mni_block *view, uint32_t id, uint32_t node,
                         unsigned char *ref_used) {
    mn_tree *t = l->tree;
    mni_node record;
    mni_place at = {l->lo[node], l->hi[node], {0}};
    memcpy(at.position, t->leaf_position + 3 * (size_t)at.leaf_lo, sizeof at.position);
    mni_block_node(view, node, &at, &record);
    uint32_t i = record.facts.order - t->leaves; /* in range: mni_block_open has seen it */
    if (l->loaded[i])
        return BAD(l, id, "node %u stands in the file twice", record.facts.order);
    l->loaded[i] = 1;
    t->leaf_lo[i] = at.leaf_lo;
    t->leaf_mid[i] = record.leaf_mid;
    t->leaf_hi[i] = at.leaf_hi;
    t->switch_value[i] = record.facts.switch_value;
    t->radius[i] = record.facts.radius;
    t->cone[i] = record.facts.cone;
    memcpy(t->leaf_position + 3 * (size_t)record.leaf_mid, record.right_position,
           sizeof record.right_position);
    if (t->leaf_color != NULL)
        t->leaf_color[record.leaf_mid] = record.right_color;
    t->left[i] = child_order(l, &record.left, at.leaf_lo, record.leaf_mid);
    t->right[i] = child_order(l, &record.right, record.leaf_mid, at.leaf_hi);
    mn_code code = add_exit(l, &record.left, i, 0);
    if (code == MN_OK)
        code = add_exit(l, &record.right, i, 1);
    l->first[i] = l->simplices;
    for (uint32_t s = 0; s < record.simplex_count && code == MN_OK; s++) {
        uint32_t corner[3];
        mni_block_simplex(view, &record, s, corner);
        code = add_simplex(l, id, corner);
    }
    if (code == MN_OK && record.overflow_ref != MN_NONE) {
        if (ref_used[record.overflow_ref]++)
            return BAD(l, id, "reference %u leads to two overflows", record.overflow_ref);
        code = load_overflow(l, mni_frame_ref(l->bytes, record.overflow_ref), id, i);
    }
    l->count[i] = l->simplices - l->first[i];
    return code;
}

/* ---- blocks --------------------------------------------------------------------------------- */

static int by_ref(const void *a, const void *b) {
    const exit_record *x = a, *y = b;
    if (x->ref != y->ref)
        return x->ref < y->ref ? -1 : 1;
    return x->subtree < y->subtree ? -1 : x->subtree > y->subtree;
}

/* What the child block says of its subtree, and what the parent's node said of it. */
static bool subtree_agrees(const loader *l, const mni_subtree *s, const mni_facts *facts,
                           const exit_record *e) {
    const mn_tree *t = l->tree;
    if (e->parent == MN_NONE)
        return true;
    uint32_t lo = e->side == 0 ? t->leaf_lo[e->parent] : t->leaf_mid[e->parent];
    uint32_t hi = e->side == 0 ? t->leaf_mid[e->parent] : t->leaf_hi[e->parent];
    return s->leaf_lo == lo && s->leaf_hi == hi && mni_facts_equal(facts, &e->facts);
}

static mn_code join_subtrees(loader *l, const mni_block *view, const task *from) {
    mn_tree *t = l->tree;
    if (view->subtrees != from->exits)
        return BAD(l, from->place.id, "%u subtrees where its parent knows of %u", view->subtrees,
                   from->exits);
    for (uint32_t i = 0; i < from->exits; i++) {
        const exit_record *e = &l->exit[from->exit_first + i];
        mni_subtree s;
        mni_facts facts;
        mni_block_subtree(view, i, &s);
        mni_block_facts(view, s.node, &facts);
        if (e->subtree != i || !subtree_agrees(l, &s, &facts, e))
            return BAD(l, from->place.id, "subtree %u is not what its parent says", i);
        l->lo[s.node] = s.leaf_lo;
        l->hi[s.node] = s.leaf_hi;
        if (e->parent == MN_NONE) {
            const mn_root *root = &l->header.root[e->side];
            memcpy(t->leaf_position + 3 * (size_t)s.leaf_lo, root->position, sizeof root->position);
            if (t->leaf_color != NULL)
                t->leaf_color[s.leaf_lo] = root->color;
            l->root_order[e->side] = facts.order;
        }
    }
    return MN_OK;
}

/* A task for each child block of the block in l->bytes, whose exits are [first, l->exits). */
static mn_code push_children(loader *l, const task *from, uint32_t first, uint32_t refs,
                             const unsigned char *ref_used) {
    qsort(l->exit + first, l->exits - first, sizeof *l->exit, by_ref);
    if (!grow((void **)&l->task, l->tasks + refs, &l->tasks_capacity, sizeof *l->task))
        return no_memory(l);
    uint32_t at = first;
    for (uint32_t r = 0; r < refs; r++) {
        uint32_t begin = at;
        while (at < l->exits && l->exit[at].ref == r)
            at++;
        if ((at > begin) + ref_used[r] != 1)
            return BAD(l, from->place.id, "reference %u is used %s", r,
                       at > begin ? "for two things" : "for nothing");
        mn_block_ref place = mni_frame_ref(l->bytes, r);
        if (!place_ok(l, place))
            return BAD(l, from->place.id, "reference %u is longer than block_bytes_max", r);
        if (at > begin)
            l->task[l->tasks++] = (task){place, from->place.id, from->depth + 1, begin, at - begin};
    }
    return MN_OK;
}

static mn_code load_block(loader *l, const task *from) {
    mni_block view;
    mni_frame frame;
    char why[160];
    mn_code code = read_block(l, from->place, l->bytes);
    if (code != MN_OK)
        return code;
    mni_frame_get(l->bytes, &frame);
    if (frame.parent_id != from->parent_id)
        return BAD(l, from->place.id, "its parent is block %u, not %u", from->parent_id,
                   frame.parent_id);
    if (!mni_block_open(&view, l->bytes, from->place.pages * MN_PAGE_BYTES, &l->limits, why,
                        sizeof why))
        return BAD(l, from->place.id, "%s", why);
    if (view.nodes > l->found.nodes_per_block_max)
        l->found.nodes_per_block_max = view.nodes;
    if (from->depth > l->found.block_depth)
        l->found.block_depth = from->depth;
    code = join_subtrees(l, &view, from);
    l->exits = from->exit_first;
    unsigned char *ref_used = calloc(frame.refs + 1, 1);
    if (ref_used == NULL)
        return no_memory(l);
    for (uint32_t i = 0; i < view.nodes && code == MN_OK; i++)
        code = load_node(l, &view, from->place.id, i, ref_used);
    if (code == MN_OK)
        code = push_children(l, from, from->exit_first, frame.refs, ref_used);
    free(ref_used);
    return code;
}

/* ---- the whole ------------------------------------------------------------------------------ */

static mn_code push_roots(loader *l) {
    const mn_header *h = &l->header;
    if (!grow((void **)&l->exit, h->roots, &l->exits_capacity, sizeof *l->exit) ||
        !grow((void **)&l->task, h->roots, &l->tasks_capacity, sizeof *l->task))
        return no_memory(l);
    for (uint32_t r = 0; r < h->roots; r++)
        l->exit[l->exits++] =
            (exit_record){MN_NONE, r, h->root[r].block.id, h->root[r].subtree, {0}};
    qsort(l->exit, l->exits, sizeof *l->exit, by_ref);
    for (uint32_t at = 0; at < l->exits;) {
        uint32_t begin = at;
        while (at < l->exits && l->exit[at].ref == l->exit[begin].ref)
            at++;
        l->task[l->tasks++] = (task){h->root[l->exit[begin].side].block, 0, 1, begin, at - begin};
    }
    return MN_OK;
}

static bool take_memory(loader *l) {
    const mn_header *h = &l->header;
    size_t inner = h->nodes - h->leaves, simplices = l->tree->simplices;
    l->bytes = malloc(h->block_bytes_max);
    l->overflow_bytes = malloc(h->block_bytes_max);
    l->loaded = calloc(inner, 1);
    l->first = malloc(sizeof *l->first * inner);
    l->count = calloc(inner, sizeof *l->count);
    l->corner = malloc(3 * sizeof *l->corner * (simplices + 1));
    l->lo = malloc(sizeof *l->lo * MNI_BLOCK_NODES_MAX);
    l->hi = malloc(sizeof *l->hi * MNI_BLOCK_NODES_MAX);
    return l->bytes != NULL && l->overflow_bytes != NULL && l->loaded != NULL && l->first != NULL &&
           l->count != NULL && l->corner != NULL && l->lo != NULL && l->hi != NULL;
}

#define SAME(l, field, format)                                                                     \
    do {                                                                                           \
        if ((l)->found.field != (l)->header.field)                                                 \
            return mn_fail((l)->st, MN_BAD_INPUT,                                                  \
                           "%s: header: " #field " is " format ", in the blocks it is " format     \
                           "; the file is damaged: build it again",                                \
                           (l)->path, (l)->header.field, (l)->found.field);                        \
    } while (0)

/* Everything that the header says of the blocks is what was found there. */
static mn_code compare_header(loader *l) {
    SAME(l, blocks, "%u");
    SAME(l, block_bytes_max, "%u");
    SAME(l, block_depth, "%u");
    SAME(l, overflow_max, "%u");
    SAME(l, children_max, "%u");
    SAME(l, nodes_per_block_max, "%u");
    SAME(l, depth_max, "%u");
    l->found.file_bytes = (l->pages + 1) * MN_PAGE_BYTES;
    if (l->found.file_bytes != l->header.file_bytes)
        return mn_fail(l->st, MN_BAD_INPUT, "%s: %llu bytes belong to no block", l->path,
                       (unsigned long long)(l->header.file_bytes - l->found.file_bytes));
    double fill = (double)l->payload_bytes / l->header.blocks / l->header.block_bytes_max;
    if (fabs(fill - l->header.fill_mean) > 1e-9)
        return mn_fail(l->st, MN_BAD_INPUT, "%s: header: fill_mean is %g, in the blocks it is %g",
                       l->path, l->header.fill_mean, fill);
    mni_tree_shape(l->tree, &l->found);
    if (memcmp(l->found.box_min, l->header.box_min, sizeof l->found.box_min) != 0 ||
        memcmp(l->found.box_max, l->header.box_max, sizeof l->found.box_max) != 0)
        return mn_fail(l->st, MN_BAD_INPUT, "%s: header: the box is not that of the vertices",
                       l->path);
    if (memcmp(l->found.dive_point, l->header.dive_point, sizeof l->found.dive_point) != 0)
        return mn_fail(l->st, MN_BAD_INPUT, "%s: header: dive_point is not the highest vertex",
                       l->path);
    mn_block_desc desc = {
        .blocking = l->header.blocking, .l = l->header.l, .block_bytes = l->header.block_bytes};
    mn_code code = mni_tree_build_id(l->tree, &desc, &l->found.build_id, l->st);
    if (code != MN_OK)
        return code;
    if (l->found.build_id != l->header.build_id)
        return mn_fail(l->st, MN_BAD_INPUT,
                       "%s: header: build_id is not that of the content; the file is damaged",
                       l->path);
    return MN_OK;
}

/* Simplices into the order of their kill nodes; then structure, as of any tree. */
static mn_code finish(loader *l) {
    mn_tree *t = l->tree;
    for (uint32_t i = 0; i < t->inner; i++) {
        if (!l->loaded[i])
            return mn_fail(l->st, MN_BAD_INPUT, "%s: node %u is in no block; build it again",
                           l->path, t->leaves + i);
        t->simplex_start[i + 1] = t->simplex_start[i] + l->count[i];
        memcpy(t->corner + 3 * (size_t)t->simplex_start[i], l->corner + 3 * (size_t)l->first[i],
               3 * sizeof *t->corner * l->count[i]);
    }
    if (l->simplices != t->simplices)
        return mn_fail(l->st, MN_BAD_INPUT, "%s: header: %u simplices, in the blocks are %u",
                       l->path, t->simplices, l->simplices);
    mn_code code = mni_tree_derive(t, l->st);
    for (uint32_t r = 0; r < t->roots && code == MN_OK; r++)
        if (t->root[r] != l->root_order[r])
            code =
                mn_fail(l->st, MN_BAD_INPUT, "%s: header: root %u is not in its place", l->path, r);
    if (code == MN_OK)
        code = mn_tree_check(t, l->st);
    l->found.depth_max = t->depth_max;
    return code == MN_OK ? compare_header(l) : code;
}

mn_code mni_mnt_load(const char *path, const mn_watch *watch, mn_tree *out, mn_header *header,
                     mn_status *st) {
    memset(out, 0, sizeof *out);
    loader l = {.path = path, .tree = out, .in = {.in = {.fd = -1}}};
    mn_status own = {0};
    l.st = st != NULL ? st : &own;
    mn_code code = mn_header_read(path, &l.header, l.st);
    const mn_header *h = &l.header;
    if (code == MN_OK)
        code = mni_stored_open(&l.in, path, h, l.st);
    if (code == MN_OK)
        code = mni_tree_alloc(out, h->leaves, h->roots, (uint32_t)h->triangles + h->hinges,
                              h->has_colors, l.st);
    if (code == MN_OK && !take_memory(&l))
        code = no_memory(&l);
    if (code == MN_OK) {
        out->triangles = (uint32_t)h->triangles;
        out->legal_last = h->legal_last;
        out->metric = h->metric;
        memcpy(out->origin, h->origin, sizeof out->origin);
        out->grid_step = h->grid_step;
        l.limits = mni_block_limits_of(h);
        code = push_roots(&l);
    }
    while (code == MN_OK && l.tasks > 0) {
        task next = l.task[--l.tasks];
        code = load_block(&l, &next);
        if (code == MN_OK && l.found.blocks % WATCH_EVERY == 0)
            code = mni_watch(watch, "loading", l.found.blocks, h->blocks, l.st);
    }
    if (code == MN_OK)
        code = finish(&l);
    if (code == MN_OK && header != NULL)
        *header = l.header;
    free(l.bytes);
    free(l.overflow_bytes);
    free(l.loaded);
    free(l.first);
    free(l.count);
    free(l.corner);
    free(l.lo);
    free(l.hi);
    free(l.task);
    free(l.exit);
    mni_stored_close(&l.in);
    if (code != MN_OK)
        mn_tree_free(out);
    return code;
}
