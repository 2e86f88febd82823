/* The pool, I/O's side and what both sides need. See pool.h. */
#include "pool.h"

#include "mn_assert.h"
#include "frame.h"
#include "trace.h"

enum { PREFETCHES_MIN = 256, PREFETCHES_MAX = 4096, KEPT_SHARE = 32, KEPT_MOST = 64 };

uint32_t mni_pool_prefetches_max(uint32_t k) {
    return k < PREFETCHES_MIN ? PREFETCHES_MIN : k > PREFETCHES_MAX ? PREFETCHES_MAX : k;
}

/* Each grant's command, and prefetches; the board's own come behind. */
static uint32_t batch_max(uint32_t k) {
    return k + mni_pool_prefetches_max(k);
}

size_t mni_pool_need(const mn_header *header, uint32_t k) {
    return mni_arena_need(batch_max(k) + mni_pool_prefetches_max(k), sizeof(mni_command),
                          _Alignof(mni_command)) +
           mni_arena_need(MNI_AHEAD_MAX, sizeof(mni_command), _Alignof(mni_command)) +
           mni_hashmap_need(MNI_AHEAD_MAX) + mni_sought_need(k) +
           mni_holders_need(k, header->block_bytes_max) + mni_hashmap_need(k) + mni_grants_need(k) +
           mni_failures_need() + mni_arena_need(k, sizeof(uint32_t), _Alignof(uint32_t));
}

void mni_pool_open(mni_pool *pool, const mni_store_desc *desc, mni_board *board, mni_arena *arena) {
    uint32_t k = desc->k;
    *pool = (mni_pool){.header = desc->header,
                       .board = board,
                       .prefetch = desc->prefetch,
                       .k_to_use = mni_store_k_to_use(desc->header, k, desc->prefetch),
                       .kept = 2 + (k / KEPT_SHARE < KEPT_MOST ? k / KEPT_SHARE : KEPT_MOST),
                       .looked_at = MNI_NO_SLOT,
                       .batch_max = batch_max(k)};
    mni_holders_open(&pool->holders, k, desc->header->block_bytes_max, arena);
    mni_hashmap_open(&pool->by_id, k, arena);
    mni_freelist_open(&pool->free, &pool->holders);
    mni_grants_open(&pool->grants, k, arena);
    mni_failures_open(&pool->failures, arena);
    pool->touched = mni_arena_take(arena, k, sizeof(uint32_t), _Alignof(uint32_t));
    pool->batch.command = mni_arena_take(arena, batch_max(k) + mni_pool_prefetches_max(k),
                                         sizeof(mni_command), _Alignof(mni_command));
    pool->batch.sorts = desc->prefetch == MN_PREFETCH_AHEAD;
    pool->ahead = mni_arena_take(arena, MNI_AHEAD_MAX, sizeof(mni_command), _Alignof(mni_command));
    mni_hashmap_open(&pool->ahead_by_id, MNI_AHEAD_MAX, arena);
    mni_sought_open(&pool->sought, k, arena);
    mni_lock_open(&pool->lock);
    pool->lock.name = MN_TRACE_LOCK_POOL;
}

void mni_pool_close(mni_pool *pool) {
    mni_lock_close(&pool->lock);
}

void mni_pool_lock(mni_pool *pool) {
    mni_lock_take(&pool->lock);
    pool->locked = true;
}

void mni_pool_unlock(mni_pool *pool) {
    MN_ASSERT(pool->locked);
    pool->locked = false;
    mni_lock_give(&pool->lock);
}

/* ---- moving between the lists ---------------------------------------------------------------- */

void mni_pool_pin_locked(mni_pool *pool, uint32_t slot, bool pinned) {
    MN_ASSERT(pool->locked);
    mni_holder *holder = &pool->holders.holder[slot];
    if (holder->pinned == pinned)
        return;
    MN_ASSERT(holder->state == MNI_HOLDER_LOADING || holder->state == MNI_HOLDER_LOADED);
    holder->pinned = pinned;
    if (holder->state == MNI_HOLDER_LOADING)
        pool->loading_plain += pinned ? UINT32_MAX : 1;
}

void mni_pool_rescue_locked(mni_pool *pool, uint32_t slot) {
    MN_ASSERT(pool->locked);
    if (pool->holders.holder[slot].state != MNI_HOLDER_FREED)
        return;
    mni_freelist_unlink(&pool->free, &pool->holders, slot);
    mni_holders_set(&pool->holders, slot, MNI_HOLDER_LOADED);
    pool->stats.second_chances++;
}

void mni_pool_release_locked(mni_pool *pool, uint32_t slot) {
    MN_ASSERT(pool->locked);
    mni_holder *holder = &pool->holders.holder[slot];
    if (holder->state != MNI_HOLDER_LOADED || !mni_holder_is_loose(holder))
        return;
    mni_holders_set(&pool->holders, slot, MNI_HOLDER_FREED);
    mni_freelist_append(&pool->free, &pool->holders, slot);
}

void mni_pool_forget_locked(mni_pool *pool, uint32_t slot) {
    MN_ASSERT(pool->locked);
    mni_holder *holder = &pool->holders.holder[slot];
    MN_ASSERT(!holder->held && !holder->in_use && !holder->pinned && !holder->touched);
    if (holder->ref.id != 0) {
        mni_hashmap_remove(&pool->by_id, holder->ref.id);
        MNI_TRACE(MN_TRACE_LOST, (uint32_t)holder->state | (uint32_t)holder->prefetched << 3,
                  holder->ref.id, slot);
    }
    holder->ref = (mn_block_ref){0};
    holder->parent_in_use = false;
    holder->children_in_use = 0;
}

void mni_pool_foresee_locked(mni_pool *pool, uint32_t slot) {
    MN_ASSERT(pool->locked);
    mni_holder *holder = &pool->holders.holder[slot];
    holder->ahead_frame = (uint32_t)pool->frame;
    if (holder->state != MNI_HOLDER_FREED)
        return;
    mni_freelist_unlink(&pool->free, &pool->holders, slot);
    mni_freelist_append(&pool->free, &pool->holders, slot);
}

/* ---- I/O: a place for a block ---------------------------------------------------------------- */

/* Does anybody still want the command? One whose sponsor has gone is cancelled here. */
static bool is_wanted(const mni_pool *pool, const mni_command *command) {
    if (!mni_command_is_urgent(command->kind) && command->sponsor == MN_NONE)
        return true;
    if (!mni_command_is_urgent(command->kind)) {
        const mni_holder *sponsor = &pool->holders.holder[command->sponsor];
        return sponsor->generation == command->sponsor_generation && sponsor->in_use;
    }
    const mni_grant *grant = &pool->grants.grant[command->sponsor];
    return grant->ref.id == command->ref.id && grant->serial == command->sponsor_generation;
}

/* The first place holder that is only prefetched, from where the last search ended. */
static uint32_t find_victim(mni_pool *pool) {
    for (uint32_t i = 0; i < pool->holders.k; i++) {
        uint32_t slot = pool->hand;
        pool->hand = (pool->hand + 1) % pool->holders.k;
        if (mni_holder_is_evictable(&pool->holders.holder[slot]))
            return slot;
    }
    return MNI_NO_SLOT;
}

static bool was_foreseen_lately(const mni_pool *pool, const mni_holder *holder) {
    return holder->ahead_frame != 0 &&
           (uint32_t)pool->frame - holder->ahead_frame <= MNI_AHEAD_FRAMES;
}

/* May the command take the first free place? Those at hand first: the free list begins with what
 * has been empty, then comes what nobody has used or foreseen for longest. */
static bool place_is_for(const mni_pool *pool, mni_places places) {
    if (places == MNI_PLACES_ANY)
        return true;
    if (pool->free.count == 0)
        return false;
    const mni_holder *first = &pool->holders.holder[pool->free.first];
    if (places == MNI_PLACES_EMPTY || first->state == MNI_HOLDER_EMPTY)
        return first->state == MNI_HOLDER_EMPTY;
    return pool->free.count > pool->kept && !was_foreseen_lately(pool, first);
}

static uint32_t take_place(mni_pool *pool, mni_places places, bool urgent) {
    if (!place_is_for(pool, places))
        return MNI_NO_SLOT;
    uint32_t slot = mni_freelist_take(&pool->free, &pool->holders);
    if (slot == MNI_NO_SLOT && urgent && pool->prefetch == MN_PREFETCH_NEIGHBOURS) {
        slot = find_victim(pool);
        pool->stats.evictions += slot != MNI_NO_SLOT;
    }
    return slot;
}

/* The command is over: its grant, if it still stands, may post another. */
static void command_over(mni_pool *pool, const mni_command *command) {
    if (mni_command_is_urgent(command->kind) && is_wanted(pool, command))
        pool->grants.grant[command->sponsor].posted = false;
}

static mni_begin begin_locked(mni_pool *pool, const mni_command *command, bool may_wait,
                              mni_load *load) {
    MN_ASSERT(pool->locked);
    bool urgent = mni_command_is_urgent(command->kind);
    if (!is_wanted(pool, command))
        return MNI_BEGIN_GIVE_UP;
    uint32_t slot = mni_hashmap_find(&pool->by_id, command->ref.id);
    if (slot != MNI_HASHMAP_NONE) {
        if (urgent) {
            mni_pool_rescue_locked(pool, slot);
            mni_pool_pin_locked(pool, slot, true);
        } else if (command->places == MNI_PLACES_SPARE) {
            mni_pool_foresee_locked(pool, slot);
        }
        const mni_holder *holder = &pool->holders.holder[slot];
        if (command->kind == MNI_COMMAND_LOOK && holder->kind == MNI_FRAME_METANODE &&
            (holder->state == MNI_HOLDER_LOADED || holder->state == MNI_HOLDER_FREED)) {
            pool->looked_at = slot;
            *load = (mni_load){.slot = slot,
                               .ref = holder->ref,
                               .last_empty = pool->holders.count[MNI_HOLDER_EMPTY] == 0,
                               .bytes = mni_holders_bytes(&pool->holders, slot)};
        }
        return MNI_BEGIN_RESIDENT;
    }
    if (command->kind == MNI_COMMAND_LOOK ||
        !mni_failures_due(&pool->failures, command->ref.id, pool->frame))
        return MNI_BEGIN_GIVE_UP;
    MN_ASSERT((uint64_t)command->ref.pages * MN_PAGE_BYTES <= pool->holders.holder_bytes);
    slot = take_place(pool, command->places, urgent);
    if (slot == MNI_NO_SLOT)
        return urgent && may_wait ? MNI_BEGIN_WAIT : MNI_BEGIN_GIVE_UP;

    mni_pool_forget_locked(pool, slot);
    mni_holder *holder = &pool->holders.holder[slot];
    holder->generation++;
    holder->ref = command->ref;
    holder->parent_id = command->parent_id;
    holder->kind = 0;
    holder->prefetched = !urgent;
    holder->ahead_frame = command->places == MNI_PLACES_SPARE ? (uint32_t)pool->frame : 0;
    mni_holders_set(&pool->holders, slot, MNI_HOLDER_LOADING);
    mni_hashmap_put(&pool->by_id, holder->ref.id, slot);
    pool->loading_plain++;
    mni_pool_pin_locked(pool, slot, urgent);
    pool->stats.reads++;
    *load = (mni_load){.slot = slot,
                       .generation = holder->generation,
                       .ref = holder->ref,
                       .parent_id = holder->parent_id,
                       .last_empty = pool->holders.count[MNI_HOLDER_EMPTY] == 0,
                       .bytes = mni_holders_bytes(&pool->holders, slot),
                       .chunk = mni_holders_chunk(&pool->holders, slot)};
    return MNI_BEGIN_READ;
}

mni_begin mni_pool_begin(mni_pool *pool, const mni_command *command, bool may_wait,
                         mni_load *load) {
    mni_pool_lock(pool);
    mni_begin begin = begin_locked(pool, command, may_wait, load);
    if (begin == MNI_BEGIN_RESIDENT || begin == MNI_BEGIN_GIVE_UP)
        command_over(pool, command);
    mni_pool_unlock(pool);
    return begin;
}

bool mni_pool_foresees(mni_pool *pool, uint32_t block_id) {
    mni_pool_lock(pool);
    uint32_t slot = mni_hashmap_find(&pool->by_id, block_id);
    if (slot != MNI_HASHMAP_NONE)
        mni_pool_foresee_locked(pool, slot);
    mni_pool_unlock(pool);
    return slot != MNI_HASHMAP_NONE;
}

void mni_pool_looked(mni_pool *pool) {
    mni_pool_lock(pool);
    pool->looked_at = MNI_NO_SLOT;
    mni_pool_unlock(pool);
}

/* ---- I/O: a read has ended ------------------------------------------------------------------- */

static bool lists(const void *bytes, uint32_t block_id) {
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    for (uint32_t i = 0; i < frame.refs; i++)
        if (mni_frame_ref(bytes, i).id == block_id)
            return true;
    return false;
}

/* The reference count of a block that has just come, from the hash table. A parent counts when it
 * names the block and is named by it; so does a child, and only once. */
static void recount(mni_pool *pool, uint32_t slot) {
    MN_ASSERT(pool->locked);
    mni_holder *holder = &pool->holders.holder[slot];
    const void *bytes = mni_holders_bytes(&pool->holders, slot);
    mni_frame frame;
    mni_frame_get(bytes, &frame);

    uint32_t parent = mni_hashmap_find(&pool->by_id, holder->parent_id);
    holder->parent_in_use = parent != MNI_HASHMAP_NONE && parent != slot &&
                            pool->holders.holder[parent].in_use &&
                            lists(mni_holders_bytes(&pool->holders, parent), holder->ref.id);
    holder->children_in_use = 0;
    uint32_t stamp = ++pool->holders.stamp;
    for (uint32_t i = 0; i < frame.refs; i++) {
        uint32_t at = mni_hashmap_find(&pool->by_id, mni_frame_ref(bytes, i).id);
        if (at == MNI_HASHMAP_NONE)
            continue;
        mni_holder *child = &pool->holders.holder[at];
        if (child->in_use && child->parent_id == holder->ref.id && child->stamp != stamp)
            holder->children_in_use++;
        child->stamp = stamp;
    }
}

static mni_holder *loading_holder(mni_pool *pool, const mni_load *load) {
    mni_holder *holder = &pool->holders.holder[load->slot];
    MN_ASSERT(holder->state == MNI_HOLDER_LOADING && holder->generation == load->generation);
    MN_ASSERT(holder->ref.id == load->ref.id);
    return holder;
}

void mni_pool_loaded(mni_pool *pool, const mni_command *command, const mni_load *load) {
    mni_frame frame;
    mni_frame_get(load->bytes, &frame); /* still ours */
    mni_pool_lock(pool);
    mni_holder *holder = loading_holder(pool, load);
    holder->parent_id = frame.parent_id;
    holder->kind = frame.kind;
    if (pool->prefetch == MN_PREFETCH_NEIGHBOURS)
        recount(pool, load->slot);
    pool->stats.read_bytes += load->read_bytes;
    pool->stats.prefetches_loaded += holder->prefetched;
    pool->loading_plain -= !holder->pinned;
    if (mni_holder_is_loose(holder)) {
        mni_holders_set(&pool->holders, load->slot, MNI_HOLDER_FREED);
        mni_freelist_append(&pool->free, &pool->holders, load->slot);
    } else {
        mni_holders_set(&pool->holders, load->slot, MNI_HOLDER_LOADED);
    }
    mni_failures_forget(&pool->failures, load->ref.id);
    command_over(pool, command);
    mni_pool_unlock(pool);
}

void mni_pool_failed(mni_pool *pool, const mni_command *command, const mni_load *load, bool io,
                     const char *why) {
    mni_pool_lock(pool);
    mni_holder *holder = loading_holder(pool, load);
    pool->loading_plain -= !holder->pinned;
    holder->pinned = false;
    mni_pool_forget_locked(pool, load->slot);
    mni_holders_set(&pool->holders, load->slot, MNI_HOLDER_EMPTY);
    mni_freelist_prepend(&pool->free, &pool->holders, load->slot);
    pool->stats.read_bytes += load->read_bytes;
    if (io)
        pool->stats.io_errors++;
    else
        pool->stats.checksum_failures++;
    if (mni_failures_add(&pool->failures, load->ref.id, pool->frame) &&
        pool->reports < MNI_REPORTS_MAX)
        pool->report[pool->reports++] = (mni_report){.block_id = load->ref.id, .why = why};
    command_over(pool, command);
    mni_pool_unlock(pool);
}

/* ---- checks ---------------------------------------------------------------------------------- */

static void check_holder(const mni_pool *pool, uint32_t slot, mni_usage_of usage_of,
                         const void *context) {
    const mni_holder *holder = &pool->holders.holder[slot];
    bool has_block = holder->state == MNI_HOLDER_LOADING || holder->state == MNI_HOLDER_LOADED ||
                     holder->state == MNI_HOLDER_FREED;
    MN_ASSERT(has_block == (holder->ref.id != 0));
    MN_ASSERT(!has_block || mni_hashmap_find(&pool->by_id, holder->ref.id) == slot);
    MN_ASSERT(holder->used == (has_block && usage_of(context, holder->ref.id) > 0));
    MN_ASSERT(!holder->used || holder->held);
    MN_ASSERT(holder->held == (holder->used || holder->touched));
    if (holder->state != MNI_HOLDER_LOADED)
        MN_ASSERT(!holder->held && !holder->in_use);
    if (holder->state != MNI_HOLDER_LOADED && holder->state != MNI_HOLDER_LOADING)
        MN_ASSERT(mni_holder_is_loose(holder));
    if (holder->state == MNI_HOLDER_LOADED)
        MN_ASSERT(!mni_holder_is_loose(holder));
    if (holder->pinned)
        MN_ASSERT(mni_grants_find(&pool->grants, holder->ref.id) != MNI_HASHMAP_NONE);
}

/* The reference count of a loaded block, from its neighbours. */
static void check_references(mni_pool *pool, uint32_t slot) {
    mni_holder *holder = &pool->holders.holder[slot];
    if (holder->state != MNI_HOLDER_LOADED && holder->state != MNI_HOLDER_FREED)
        return;
    mni_holder before = *holder;
    holder->parent_in_use = false;
    holder->children_in_use = 0;
    if (pool->prefetch == MN_PREFETCH_NEIGHBOURS) /* otherwise nobody counts */
        recount(pool, slot);
    MN_ASSERT(before.parent_in_use == holder->parent_in_use);
    MN_ASSERT(before.children_in_use == holder->children_in_use);
}

static void check_freelist(const mni_pool *pool) {
    uint32_t count = 0, prev = MNI_NO_SLOT;
    for (uint32_t slot = pool->free.first; slot != MNI_NO_SLOT;
         slot = pool->holders.holder[slot].next) {
        const mni_holder *holder = &pool->holders.holder[slot];
        MN_ASSERT(holder->state == MNI_HOLDER_EMPTY || holder->state == MNI_HOLDER_FREED);
        MN_ASSERT(holder->prev == prev);
        prev = slot;
        MN_ASSERT(++count <= pool->holders.k);
    }
    MN_ASSERT(pool->free.last == prev && pool->free.count == count);
    MN_ASSERT(count ==
              pool->holders.count[MNI_HOLDER_EMPTY] + pool->holders.count[MNI_HOLDER_FREED]);
}

void mni_pool_check(mni_pool *pool, mni_usage_of usage_of, const void *context) {
    mni_holders *holders = &pool->holders;
    uint32_t count[MNI_HOLDER_STATES] = {0}, sum = 0, touched = 0, loading_plain = 0;
    mni_pool_lock(pool);
    MN_ASSERT(pool->k_to_use == mni_store_k_to_use(pool->header,
                                                   holders->k - holders->count[MNI_HOLDER_RETIRED],
                                                   pool->prefetch));
    for (uint32_t slot = 0; slot < holders->k; slot++) {
        check_holder(pool, slot, usage_of, context);
        check_references(pool, slot);
        count[holders->holder[slot].state]++;
        touched += holders->holder[slot].touched;
        loading_plain +=
            holders->holder[slot].state == MNI_HOLDER_LOADING && !holders->holder[slot].pinned;
    }
    for (int state = 0; state < MNI_HOLDER_STATES; state++) {
        MN_ASSERT(count[state] == holders->count[state]);
        sum += count[state];
    }
    MN_ASSERT(sum == holders->k && touched == pool->touched_count);
    MN_ASSERT(loading_plain == pool->loading_plain);
    MN_ASSERT(pool->by_id.count ==
              count[MNI_HOLDER_LOADING] + count[MNI_HOLDER_LOADED] + count[MNI_HOLDER_FREED]);
    check_freelist(pool);
    mni_grants_check(&pool->grants);
    mni_pool_unlock(pool);
}
