/* See settle.h.
 *
 * Hides: how a front settles without anybody's neighbours. It is the least set of split nodes that
 * has all that are wanted, the parent of each, and whoever a split waits for: a node is split only
 * while its order id is above those of its neighbours (design.md §2), so when p splits, all that is
 * later than p on the way from a neighbour's leaf to the root has been split. Said of one simplex
 * that is active, for each of its corners:
 *
 *   of the nodes that hold the corner's leaf, all are split whose order ids are above m,
 *   the least order id of a split node that holds one of the simplex's leaves
 *
 * and that is the whole condition. So walks (walk.h) through the split top of the tree look at one
 * simplex after the other, split what is missing, and end with one that misses nothing; each looks
 * only at simplices one of whose active nodes has changed since it was looked at. Up to 10 walks
 * were seen on scans and terrains, 31 on a flat grid; the later ones split few (docs/design.md).
 *
 * Nodes are found by order ids alone, which stand in a table by rows. What lies between two leaves
 * at which active nodes begin is one active node; its parent is the one of both rows that has the
 * lesser order id, and its own is the greatest in between. Those that hold a leaf are the rows that
 * rise above all that lie between them and the leaf:
 *
 *   row          8   9  10  11  12  13  14  15         splits at 8 and 15: one active node, 14 on
 *   order id    70  22  25   .  31  28  52  60 …       top, its parent in row 15; leaf 11 is held
 * by ▲                        ◄─ leaf 11    rows 10 on its left, 12 and 14 on its right
 *
 * Order: mni_settle alone. One thread; calls block on the disk. Memory: work_bytes and a walk's:
 * pages of the table, which is 4 bytes a leaf in a temporary file, a few answers about active
 * nodes, and 2 bits for 64 leaves. Paper: §2.2 (implicit dependencies). */
#include "settle.h"

#include <string.h>

#include "pages.h"
#include "watch.h"

enum {
    PAGE_BYTES = 4096,
    PAGE_ROWS = PAGE_BYTES / sizeof(uint32_t),
    ANSWERS_BITS = 12, /* a hub's simplices ask for the same node again and again */
    ANSWERS = 1 << ANSWERS_BITS,
    ALIGN = 64,
};

/* An active node. Depends on where it begins and ends alone. */
typedef struct active {
    uint32_t begin, end; /* leaves [begin, end); end 0: nothing is known */
    uint32_t order;      /* 0: a leaf */
    uint32_t parent;     /* MN_NONE: it is a root */
} active;

typedef struct settling {
    mni_walked *file;
    const mni_settle_desc *desc;
    mni_front *front;
    uint64_t *split; /* the front's nodes by number: whom walks go to */
    mni_arena arena;
    mni_spill spill;
    mni_pages table;      /* row: order id, MN_NONE where a root begins */
    uint32_t page_number; /* of the page that was asked for last */
    const uint32_t *page;
    active *answer;
    uint64_t *changed; /* a bit for 64 leaves: has an active node there been split in this walk */
    uint64_t *before;  /* or in the one before? */
    bool is_split;     /* the node of the row that came last */
    uint64_t splits;   /* in this walk */
    mn_status *st;
} settling;

/* ---- memory --------------------------------------------------------------------------------- */

static uint64_t changed_words(uint32_t leaves) {
    return mni_front_words(leaves) / 64 + 1;
}

static uint64_t beside_pages(uint32_t leaves) {
    return 2 * mni_arena_need(changed_words(leaves), sizeof(uint64_t), ALIGN) +
           mni_arena_need(ANSWERS, sizeof(active), ALIGN);
}

uint64_t mni_settle_least(uint32_t leaves) {
    return beside_pages(leaves) + 4 * MNI_PAGES_BUDGET_MIN;
}

uint64_t mni_settle_most(uint32_t leaves) {
    const uint64_t pages = (uint64_t)leaves / PAGE_ROWS + 9; /* whole sets */
    return mni_settle_least(leaves) + pages * (PAGE_BYTES + sizeof(mni_pages_slot));
}

static mn_code take_memory(settling *s) {
    const uint32_t leaves = s->front->leaves;
    const uint64_t words = changed_words(leaves);
    mn_code code = mni_arena_open(&s->arena, s->desc->work_bytes, s->st);
    if (code == MN_OK)
        code = mni_spill_open(&s->spill, s->desc->temp_dir, s->st);
    if (code != MN_OK)
        return code;
    s->changed = mni_arena_take(&s->arena, words, sizeof *s->changed, ALIGN);
    s->before = mni_arena_take(&s->arena, words, sizeof *s->before, ALIGN);
    s->answer = mni_arena_take(&s->arena, ANSWERS, sizeof *s->answer, ALIGN);
    mni_pages_open(&s->table, &s->spill, sizeof(uint32_t), PAGE_BYTES, leaves, &s->arena,
                   s->desc->work_bytes - beside_pages(leaves));
    return MN_OK;
}

static bool is_split(const void *context, uint32_t order) {
    const settling *s = context;
    return mni_bit(s->split, order - s->front->leaves);
}

static mn_code walk(settling *s, const mni_walk_sink *sink, bool all) {
    const mni_walk_desc desc = {.ram_bytes = s->desc->ram_bytes,
                                .held_bytes = s->desc->held_bytes + s->desc->work_bytes,
                                .wanted = all ? NULL : is_split,
                                .watch = s->desc->watch,
                                .phase = all ? "checking" : "settling"};
    return mni_walk_file(s->file, &desc, sink, s->st);
}

static mn_code trouble(const settling *s) {
    return s->spill.trouble.code == MN_OK
               ? MN_OK
               : mn_fail(s->st, s->spill.trouble.code, "%s", s->spill.trouble.text);
}

/* ---- what is wanted ------------------------------------------------------------------------- */

static mn_code take_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    settling *s = context;
    uint32_t *order = mni_pages_at(&s->table, at, true);
    if (order == NULL)
        return trouble(s);
    *order = child == NULL ? MN_NONE : row->order;
    if (child == NULL || row->switch_value > s->desc->switch_value)
        mni_bit_set(s->front->begins, at);
    if (child != NULL && row->switch_value > s->desc->switch_value)
        mni_bit_set(s->split, row->order - s->front->leaves);
    return MN_OK;
}

/* ---- active nodes --------------------------------------------------------------------------- */

/* Where the table cannot be read, 0: the walk is about to end. */
static uint32_t order_at(settling *s, uint32_t row) {
    static const uint32_t nothing[PAGE_ROWS];
    if (row / PAGE_ROWS != s->page_number) {
        s->page = mni_pages_find(&s->table, row / PAGE_ROWS, false);
        s->page_number = row / PAGE_ROWS;
        if (s->page == NULL)
            s->page = nothing;
    }
    return s->page[row % PAGE_ROWS];
}

static const active *active_at(settling *s, uint32_t leaf) {
    const uint32_t begin = mni_front_begin(s->front, leaf), end = mni_front_end(s->front, leaf);
    active *a = &s->answer[begin * UINT32_C(2654435761) >> (32 - ANSWERS_BITS)];
    if (a->begin == begin && a->end == end)
        return a;
    const uint32_t left = order_at(s, begin);
    uint32_t order = 0;
    for (uint32_t row = begin + 1; row < end; row++) {
        const uint32_t here = order_at(s, row);
        order = here > order ? here : order;
    }
    const uint32_t right = end < s->front->leaves ? order_at(s, end) : MN_NONE;
    *a = (active){begin, end, order, left < right ? left : right};
    return a;
}

static void split_row(settling *s, uint32_t row, uint32_t order) {
    mni_bit_set(s->front->begins, row);
    mni_bit_set(s->split, order - s->front->leaves);
    s->splits++;
}

/* Those of an active node and below it that hold the leaf and have order ids above m. */
static void split_above(settling *s, active a, uint32_t leaf, uint32_t m) {
    uint32_t highest = m;
    for (uint32_t row = leaf; row > a.begin; row--)
        if (order_at(s, row) > highest)
            split_row(s, row, highest = order_at(s, row));
    highest = m;
    for (uint32_t row = leaf + 1; row < a.end; row++)
        if (order_at(s, row) > highest)
            split_row(s, row, highest = order_at(s, row));
    for (uint32_t word = a.begin / 64; word <= (a.end - 1) / 64; word++)
        mni_bit_set(s->changed, word);
}

/* ---- what must be split with it ------------------------------------------------------------- */

static mn_code note_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    settling *s = context;
    (void)row;
    s->is_split = child != NULL && mni_bit(s->front->begins, at);
    return MN_OK;
}

static bool has_changed(const settling *s, const uint32_t *corner, int corners) {
    for (int i = 0; i < corners; i++)
        if (mni_bit(s->changed, corner[i] / 64) || mni_bit(s->before, corner[i] / 64))
            return true;
    return false;
}

static mn_code settle_simplex(void *context, const mni_row_simplex *simplex) {
    settling *s = context;
    const uint32_t *corner = simplex->corner;
    const int corners = corner[2] == MN_NONE ? 2 : 3;
    active node[3];
    uint32_t m = MN_NONE;
    if (!s->is_split || !has_changed(s, corner, corners))
        return MN_OK;
    for (int i = 0; i < corners; i++) {
        node[i] = *active_at(s, corner[i]);
        m = node[i].parent < m ? node[i].parent : m;
    }
    for (int i = 0; i < corners; i++)
        if (node[i].order > m)
            split_above(s, node[i], corner[i], m);
    return trouble(s);
}

static mn_code settle(settling *s) {
    const mni_walk_sink rows = {.row = take_row, .context = s};
    const mni_walk_sink simplices = {note_row, settle_simplex, s};
    const uint64_t bytes = changed_words(s->front->leaves) * sizeof *s->changed;
    mn_code code = walk(s, &rows, true);
    s->page_number = UINT32_MAX;
    memset(s->changed, 0xff, bytes);
    for (s->splits = 1; s->splits > 0 && code == MN_OK;) {
        uint64_t *const before = s->changed;
        s->changed = s->before;
        s->before = before;
        memset(s->changed, 0, bytes);
        s->splits = 0;
        code = mni_watch(s->desc->watch, "settling", 0, s->front->leaves, s->st);
        if (code == MN_OK)
            code = walk(s, &simplices, false);
    }
    return code;
}

mn_code mni_settle(mni_walked *file, const mni_settle_desc *desc, mni_front *front, uint64_t *split,
                   mn_status *st) {
    settling s = {
        .file = file, .desc = desc, .front = front, .split = split, .spill = {.fd = -1}, .st = st};
    mn_code code = take_memory(&s);
    if (code == MN_OK)
        code = settle(&s);
    mni_spill_close(&s.spill);
    mni_arena_close(&s.arena);
    return code;
}
