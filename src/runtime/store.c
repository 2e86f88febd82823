/* The blocks that Navigate uses: see store.h.
 *
 * Secret: usage counts live in the ancestor table, and only when one leaves or reaches 0 does the
 * store behind it hear of it. So most calls touch one entry and no lock. Navigate only; memory from
 * the arena, bounded by entries_max. (Paper §3.3.2, §3.3.3; design.md §3.5, §4) */
#include "store.h"

#include "ancestors.h"
#include "mn_assert.h"
#include "store_kind.h"

/* One in so many of the place holders above the fewest: what two frames of a fast dive bring. */
enum { TO_COME_SHARE = 16 };

struct mni_store {
    /* const after open */
    const mni_store_kind *kind;
    void *blocks; /* the kind's own */
    const mn_header *header;
    /* Navigate only */
    mni_ancestors table;
    uint32_t absent_id;           /* the last MNI_ABSENT */
    bool table_full;              /* what the last MNI_REFUSED was about, and no block */
    mni_entry root[MN_ROOTS_MAX]; /* of their blocks, in use from open on */
};

static const mni_store_kind *kind_of(mn_store_kind kind) {
    switch (kind) {
    case MN_STORE_PAGED:
        break;
    case MN_STORE_MAPPED:
        return &mni_store_mapped;
    case MN_STORE_RESIDENT:
        return &mni_store_resident;
    }
    return &mni_store_paged;
}

/* ---- size ----------------------------------------------------------------------------------- */

static uint32_t root_blocks(const mn_header *header) {
    uint32_t count = 0;
    for (uint32_t r = 0; r < header->roots; r++) {
        bool known = false;
        for (uint32_t before = 0; before < r && !known; before++)
            known = header->root[before].block.id == header->root[r].block.id;
        count += !known;
    }
    return count;
}

uint32_t mni_store_k_min(const mn_header *header) {
    uint32_t roots = root_blocks(header);
    if (header->blocking == MN_BLOCKING_LEVELS)
        return (roots + 3 > 5 ? roots + 3 : 5) + header->overflow_max;
    return header->block_depth + 2 + header->overflow_max + (roots - 1);
}

uint32_t mni_store_k_to_use(const mn_header *header, uint32_t k, mn_prefetch prefetch) {
    if (prefetch != MN_PREFETCH_AHEAD || header->blocking != MN_BLOCKING_PACKED)
        return k;
    return k - (k - mni_store_k_min(header)) / TO_COME_SHARE;
}

mn_code mni_store_can(const mn_header *header, mn_store_kind kind, const char *path,
                      mn_status *st) {
    if (kind != MN_STORE_MAPPED || header->zstd_level == 0)
        return MN_OK;
    return mn_fail(st, MN_USAGE,
                   "%s: its blocks are compressed, and a mapped file has them as they are: use "
                   "another --store, or write them anew with metanode block, without --zstd",
                   path);
}

uint32_t mni_store_entries_max(const mn_header *header, mn_store_kind kind, uint32_t k) {
    return kind_of(kind)->entries_max(header, k);
}

size_t mni_store_need_bytes(const mn_header *header, mn_store_kind kind, uint32_t k) {
    return mni_arena_need(1, sizeof(mni_store), _Alignof(mni_store)) +
           mni_ancestors_need(mni_store_entries_max(header, kind, k)) +
           kind_of(kind)->need_bytes(header, k);
}

/* A block that is longer than a place holder, or not in the file, is absent for ever. */
static bool ref_is_sound(const mn_header *header, mn_block_ref ref) {
    return ref.id > 0 && ref.pages > 0 &&
           (uint64_t)ref.pages * MN_PAGE_BYTES <= header->block_bytes_max &&
           ((uint64_t)ref.id + ref.pages) * MN_PAGE_BYTES <= header->file_bytes;
}

/* ---- into use ------------------------------------------------------------------------------- */

static mni_wish wish_for(const mni_store *store, mni_way way, mn_block_ref ref, mni_entry parent) {
    const mni_ancestors *table = &store->table;
    mni_wish wish = {.way = way, .ref = ref, .table_count = table->count, .in_use = table->in_use};
    if (parent != MNI_NO_ENTRY) {
        wish.parent = table->entry[parent].ref;
        wish.grandparent_id = mni_ancestors_parent_id(table, parent);
    }
    return wish;
}

static void note_answer(mni_store *store, const mni_wish *wish, mni_answer answer) {
    if (answer == MNI_ABSENT)
        store->absent_id = wish->ref.id;
    if (answer == MNI_GRANTED)
        MNI_TRACE(MN_TRACE_USE, 0, wish->ref.id, wish->parent.id);
    else if (answer == MNI_ABSENT)
        MNI_TRACE(MN_TRACE_ABSENT, 0, wish->ref.id, wish->parent.id);
}

static mni_answer down(mni_store *store, mni_entry parent, mn_block_ref ref, mni_entry *out) {
    mni_ancestors *table = &store->table;
    *out = MNI_NO_ENTRY;
    store->absent_id = 0;
    if (!ref_is_sound(store->header, ref))
        return MNI_ABSENT;
    mni_entry e = mni_ancestors_find(table, ref.id);
    if (e != MNI_NO_ENTRY &&
        (table->entry[e].parent != parent || table->entry[e].ref.pages != ref.pages))
        return MNI_ABSENT; /* a lying file: the block has another parent already */
    if (e != MNI_NO_ENTRY && table->entry[e].usage > 0) {
        table->entry[e].usage++;
        *out = e;
        return MNI_GRANTED;
    }
    store->table_full = e == MNI_NO_ENTRY && table->count == table->max;
    if (store->table_full)
        return MNI_REFUSED;
    mni_wish wish = wish_for(store, MNI_WAY_DOWN, ref, parent);
    wish.adds = e == MNI_NO_ENTRY;
    const void *bytes = NULL;
    mni_answer answer = store->kind->enter(store->blocks, &wish, &bytes);
    note_answer(store, &wish, answer);
    if (answer == MNI_GRANTED)
        *out = mni_ancestors_enter(table, ref, parent, bytes);
    return answer;
}

/* ---- open, close ---------------------------------------------------------------------------- */

/* The kind has loaded and checked them; but a header may say of any block that it is a root's. */
static mn_code take_roots(mni_store *store, const char *path, mn_status *st) {
    for (uint32_t r = 0; r < store->header->roots; r++)
        if (down(store, MNI_NO_ENTRY, store->header->root[r].block, &store->root[r]) != MNI_GRANTED)
            return mn_fail(st, MN_BAD_INPUT,
                           "%s: root %u: block %u is no root's; copy or build it again", path, r,
                           store->header->root[r].block.id);
    return MN_OK;
}

mn_code mni_store_open(const mni_store_desc *desc, mni_arena *arena, mni_store **out,
                       mn_status *st) {
    *out = NULL;
    for (uint32_t r = 0; r < desc->header->roots; r++)
        if (!ref_is_sound(desc->header, desc->header->root[r].block))
            return mn_fail(st, MN_BAD_INPUT,
                           "%s: root %u: its block is not in the file; copy or "
                           "build it again",
                           desc->path, r);
    mni_store *store = mni_arena_take(arena, 1, sizeof *store, _Alignof(mni_store));
    store->kind = kind_of(desc->kind);
    store->header = desc->header;
    mni_ancestors_open(&store->table, mni_store_entries_max(desc->header, desc->kind, desc->k),
                       arena);
    mn_code code = store->kind->open(desc, arena, &store->blocks, st);
    if (code != MN_OK)
        return code;
    code = take_roots(store, desc->path, st);
    if (code == MN_OK)
        *out = store;
    else
        store->kind->close(store->blocks);
    return code;
}

void mni_store_close(mni_store *store) {
    if (store != NULL)
        store->kind->close(store->blocks);
}

/* ---- into use and out of it ----------------------------------------------------------------- */

mni_entry mni_store_root(const mni_store *store, uint32_t r) {
    MN_ASSERT(r < store->header->roots);
    return store->root[r];
}

mni_answer mni_store_down(mni_store *store, mni_entry parent, mn_block_ref ref, mni_entry *out) {
    MN_ASSERT(parent < store->table.max && store->table.entry[parent].usage > 0);
    return down(store, parent, ref, out);
}

mni_answer mni_store_up(mni_store *store, mni_entry entry) {
    MN_ASSERT(entry < store->table.max && store->table.entry[entry].ref.id != 0);
    mni_ancestor *ancestor = &store->table.entry[entry];
    if (ancestor->usage > 0) {
        ancestor->usage++;
        return MNI_GRANTED;
    }
    mni_wish wish = wish_for(store, MNI_WAY_UP, ancestor->ref, ancestor->parent);
    const void *bytes = NULL;
    mni_answer answer = store->kind->enter(store->blocks, &wish, &bytes);
    note_answer(store, &wish, answer);
    if (answer == MNI_GRANTED)
        mni_ancestors_enter(&store->table, ancestor->ref, ancestor->parent, bytes);
    return answer;
}

void mni_store_add(mni_store *store, mni_entry entry) {
    MN_ASSERT(entry < store->table.max && store->table.entry[entry].usage > 0);
    store->table.entry[entry].usage++;
}

static inline void left(mni_store *store) {
    if (store->kind->left != NULL)
        store->kind->left(store->blocks);
}

void mni_store_sub(mni_store *store, mni_entry entry) {
    MN_ASSERT(entry < store->table.max);
    mni_ancestor *lowered = &store->table.entry[entry];
    if (lowered->usage > 1) { /* nearly always */
        lowered->usage--;
        left(store);
        return;
    }
    uint32_t block_id = lowered->ref.id;
    if (!mni_ancestors_lower(&store->table, entry)) {
        left(store);
        return;
    }
    MNI_TRACE(MN_TRACE_LEAVE, 0, block_id, 0);
    store->kind->leave(store->blocks, block_id,
                       mni_ancestors_find(&store->table, block_id) == MNI_NO_ENTRY);
}

void mni_store_attempt_over(mni_store *store) {
    if (store->kind->attempt_over != NULL)
        store->kind->attempt_over(store->blocks);
}

bool mni_store_absent(const mni_store *store, uint32_t *block_id) {
    *block_id = store->absent_id;
    return store->absent_id != 0 && store->kind->comes != NULL &&
           store->kind->comes(store->blocks, store->absent_id);
}

mni_refusal mni_store_refusal(const mni_store *store, bool alone) {
    if (store->table_full || store->kind->refusal == NULL)
        return (mni_refusal){0};
    return store->kind->refusal(store->blocks, alone);
}

void mni_store_refuse(mni_store *store, const mni_refusal *known) {
    const mni_ancestors *table = &store->table;
    MN_ASSERT(known->block_id != 0 && known->need > 0 && store->kind->refuse != NULL);
    store->table_full = false;
    store->kind->refuse(store->blocks, known, table->count, table->in_use);
}

int64_t mni_store_room(const mni_store *store) {
    const mni_ancestors *table = &store->table;
    return store->kind->room != NULL ? store->kind->room(store->blocks, table->count, table->in_use)
                                     : INT64_MAX;
}

bool mni_store_has_place(const mni_store *store, mn_block_ref ref) {
    return mni_ancestors_find(&store->table, ref.id) != MNI_NO_ENTRY ||
           store->kind->has_place == NULL || store->kind->has_place(store->blocks, ref.id) ||
           !ref_is_sound(store->header, ref);
}

void mni_store_no_room(mni_store *store, mni_entry parent, mn_block_ref ref, uint32_t blocks) {
    const mni_wish wish = wish_for(store, MNI_WAY_DOWN, ref, parent);
    MN_ASSERT(store->kind->no_room != NULL && (int64_t)blocks > mni_store_room(store));
    MN_ASSERT(ref_is_sound(store->header, ref));
    store->table_full = false;
    store->kind->no_room(store->blocks, &wish, blocks);
}

bool mni_store_allows(const mni_store *store, const mni_refusal *refusal, bool lenient) {
    const mni_ancestors *table = &store->table;
    MN_ASSERT(refusal->block_id != 0 && refusal->need > 0);
    return store->kind->room(store->blocks, table->count, table->in_use) >=
               (lenient ? 1 : refusal->need) ||
           mni_ancestors_find(table, refusal->block_id) != MNI_NO_ENTRY;
}

const void *mni_store_bytes(mni_store *store, mni_entry entry, bool *fresh) {
    mni_ancestor *ancestor = &store->table.entry[entry];
    MN_ASSERT(entry < store->table.max && ancestor->usage > 0);
    *fresh = ancestor->fresh;
    ancestor->fresh = false;
    return ancestor->bytes;
}

uint32_t mni_store_usage(const mni_store *store, mni_entry entry) {
    MN_ASSERT(entry < store->table.max);
    return store->table.entry[entry].usage;
}

uint32_t mni_store_block_id(const mni_store *store, mni_entry entry) {
    MN_ASSERT(entry < store->table.max);
    return store->table.entry[entry].ref.id;
}

mni_answer mni_store_overflow(mni_store *store, mni_entry owner, mn_block_ref ref,
                              const void **bytes) {
    MN_ASSERT(owner < store->table.max && store->table.entry[owner].usage > 0);
    *bytes = NULL;
    store->table_full = false;
    store->absent_id = 0;
    if (!ref_is_sound(store->header, ref))
        return MNI_ABSENT;
    mni_wish wish = wish_for(store, MNI_WAY_OVERFLOW, ref, owner);
    wish.adds = true;
    const mni_answer answer = store->kind->overflow(store->blocks, &wish, bytes);
    note_answer(store, &wish, answer);
    if (answer == MNI_GRANTED) /* for this one split */
        MNI_TRACE(MN_TRACE_LEAVE, 0, ref.id, 0);
    return answer;
}

/* ---- foresight ------------------------------------------------------------------------------ */

void mni_store_look(mni_store *store, const void *look) {
    if (store->kind->look != NULL)
        store->kind->look(store->blocks, look);
}

void mni_store_ahead_down(mni_store *store, mni_entry parent, mn_block_ref ref, uint32_t frames) {
    MN_ASSERT(parent < store->table.max && store->table.entry[parent].usage > 0);
    if (store->kind->ahead != NULL && ref_is_sound(store->header, ref))
        store->kind->ahead(store->blocks, ref, store->table.entry[parent].ref.id, frames);
}

void mni_store_ahead_up(mni_store *store, mni_entry entry, uint32_t frames) {
    MN_ASSERT(entry < store->table.max && store->table.entry[entry].ref.id != 0);
    if (store->kind->ahead != NULL)
        store->kind->ahead(store->blocks, store->table.entry[entry].ref,
                           mni_ancestors_parent_id(&store->table, entry), frames);
}

void mni_store_note(mni_store *store, mn_block_ref ref, const mni_note *note) {
    if (store->kind->note != NULL)
        store->kind->note(store->blocks, ref.id, note);
}

void mni_store_early(mni_store *store, uint32_t frames) {
    mni_trace_early(frames > 0);
    if (store->kind->early != NULL)
        store->kind->early(store->blocks, frames);
}

bool mni_store_there_only(mni_store *store, bool only) {
    return store->kind->there_only != NULL && store->kind->there_only(store->blocks, only);
}

bool mni_store_seek(mni_store *store, const mni_refusal *refusal) {
    return store->kind->seek != NULL && store->kind->seek(store->blocks, refusal->block_id);
}

bool mni_store_has(mni_store *store, const mni_refusal *refusal) {
    return store->kind->has == NULL || store->kind->has(store->blocks, refusal->block_id);
}

/* ---- frames --------------------------------------------------------------------------------- */

void mni_store_frame_begin(mni_store *store) {
    store->kind->frame_begin(store->blocks);
}

void mni_store_frame_end(mni_store *store, double frame_s) {
    MNI_TRACE(MN_TRACE_PHASE, MN_TRACE_STORE, 0, 0);
    MNI_TRACE_COUNT(MN_TRACE_N_IN_USE, store->table.in_use);
    MNI_TRACE_COUNT(MN_TRACE_N_ANCESTORS, store->table.count);
    store->kind->frame_end(store->blocks, frame_s);
}

void mni_store_post(mni_store *store) {
    if (store->kind->post != NULL)
        store->kind->post(store->blocks);
}

void mni_store_meanwhile(mni_store *store, double seconds) {
    if (store->kind->meanwhile != NULL)
        store->kind->meanwhile(store->blocks, seconds);
}

void mni_store_drain(mni_store *store) {
    store->kind->drain(store->blocks);
}

uint32_t mni_store_pending(mni_store *store) {
    return store->kind->pending(store->blocks);
}

uint64_t mni_store_epoch(const mni_store *store) {
    return store->kind->epoch(store->blocks);
}

uint32_t mni_store_in_use(const mni_store *store) {
    return store->table.in_use;
}

uint32_t mni_store_in_memory(mni_store *store) {
    return store->kind->resident(store->blocks, store->table.in_use);
}

double mni_store_fill(const mni_store *store) {
    const mni_ancestors *table = &store->table;
    return store->kind->fill != NULL ? store->kind->fill(store->blocks, table->count, table->in_use)
                                     : 0;
}

uint32_t mni_store_with_ancestors(const mni_store *store) {
    return store->table.count;
}

bool mni_store_shrink(mni_store *store) {
    return store->kind->shrink != NULL && store->kind->shrink(store->blocks, store->table.count);
}

bool mni_store_grow(mni_store *store) {
    return store->kind->grow != NULL && store->kind->grow(store->blocks);
}

void mni_store_stats(mni_store *store, mn_session_stats *out) {
    store->kind->stats(store->blocks, out);
}

/* ---- checks --------------------------------------------------------------------------------- */

static uint32_t usage_of_block(const void *context, uint32_t block_id) {
    const mni_ancestors *table = context;
    mni_entry e = mni_ancestors_find(table, block_id);
    return e == MNI_NO_ENTRY ? 0 : table->entry[e].usage;
}

void mni_store_check_all(mni_store *store, uint32_t (*usage_of)(void *context, mni_entry entry),
                         void *context) {
    const mni_ancestors *table = &store->table;
    mni_ancestors_check(table);
    for (mni_entry e = 0; usage_of != NULL && e < table->max; e++)
        if (table->entry[e].ref.id != 0)
            MN_ASSERT(usage_of(context, e) == table->entry[e].usage);
    store->kind->check(store->blocks, usage_of_block, table);
}
