/* The pool, Navigate's side: which switches are allowed, what they take, and the end of a frame.
 * See pool.h for threads and memory.
 *
 * Attempts. Navigate takes the blocks of a split, and of the splits forced by it, into use one
 * after the other (enter). When one is absent or refused it gives back those it has (leave), or
 * what it has split stays, and they stay in use (chain.c); either way the attempt ends there, and
 * the asks up to then are one. If a block of it is absent and none is refused, it stands: what it
 * gives back is granted, and stays until it is not asked for again. If one is refused, the chain is
 * given up, and what it gives back goes.
 *
 * The rules (design.md §4, repairs a and b), with K the place holders in service, U the blocks in
 * use, A the ancestor table and G the grants not in use:
 *
 *   packed   switch down     |A| + added + (G outside A) <= K - (places left for what is to come)
 *   levels   switch down     K - (U + 1) - G - (being read for no grant) >= 1; while it is only the
 *                            reads that stand in the way, the answer is "absent": they will end
 *            urgent down     K - U - G >= 3
 *   both     overflow        as a switch down that adds to G alone
 *   both     K >= blocks     no rule: each block has a place of its own
 */
#include "mn_assert.h"
#include "frame.h"
#include "pool.h"
#include "trace.h"

enum {
    URGENT_DOWN_SPARE = 3, /* paper §3.3.2: a split adds at most two, one stays */
    PLENTY_SHARE = 6,      /* one in so many place holders is free: what is foreseen costs nobody */
    BESIDE_FRAMES = 8,     /* later than most of what is foreseen */
};

/* ---- the rules ------------------------------------------------------------------------------- */

static uint32_t k_in_service(const mni_pool *pool) {
    return pool->holders.k - pool->holders.count[MNI_HOLDER_RETIRED];
}

/* Place holders that packed blocks in use and their ancestors may have. */
static int64_t k_to_use(const mni_pool *pool) {
    return pool->k_to_use;
}

/* Place holders have gone out of service, or into it. */
static void serve(mni_pool *pool) {
    pool->k_to_use = mni_store_k_to_use(pool->header, k_in_service(pool), pool->prefetch);
}

/* What they leave for what is to come. */
static uint32_t to_come(const mni_pool *pool) {
    return k_in_service(pool) - (uint32_t)k_to_use(pool);
}

/* By how much the rules fail; 0 and below: they hold. own: the block's own grant, or
 * MNI_HASHMAP_NONE. */

/* May the block come into use, now that it is there? loads: it may not only because of reads that
 * will end. */
static int64_t down_lacks(const mni_pool *pool, const mni_wish *wish, uint32_t own, bool *loads) {
    MN_ASSERT(pool->locked);
    int64_t k = k_in_service(pool);
    const mni_grant *grant =
        own != MNI_HASHMAP_NONE && !pool->grants.grant[own].used ? &pool->grants.grant[own] : NULL;
    *loads = false;
    if (wish->parent.id == 0 || k >= pool->header->blocks)
        return 0;
    if (pool->header->blocking == MN_BLOCKING_PACKED) {
        int64_t outside = (int64_t)pool->grants.idle_outside - (grant != NULL && grant->outside);
        return (int64_t)wish->table_count + wish->adds + outside - k_to_use(pool);
    }
    int64_t spare = k - (wish->in_use + 1) - ((int64_t)pool->grants.idle - (grant != NULL));
    *loads = spare >= 1;
    return 1 - (spare - pool->loading_plain);
}

static int64_t urgent_lacks(const mni_pool *pool, const mni_wish *wish, uint32_t own) {
    bool loads = false;
    int64_t k = k_in_service(pool);
    if (pool->header->blocking == MN_BLOCKING_PACKED)
        return down_lacks(pool, wish, own, &loads);
    if (wish->parent.id == 0 || k >= pool->header->blocks)
        return 0;
    bool idle = own != MNI_HASHMAP_NONE && !pool->grants.grant[own].used;
    return URGENT_DOWN_SPARE - (k - wish->in_use - ((int64_t)pool->grants.idle - idle));
}

static int64_t overflow_lacks(const mni_pool *pool, const mni_wish *wish, uint32_t own) {
    MN_ASSERT(pool->locked);
    int64_t k = k_in_service(pool);
    bool has = own != MNI_HASHMAP_NONE;
    if (has || k >= pool->header->blocks)
        return 0; /* counted already */
    if (pool->header->blocking == MN_BLOCKING_PACKED)
        return (int64_t)wish->table_count + pool->grants.idle_outside + 1 - k_to_use(pool);
    return 1 - (k - wish->in_use - ((int64_t)pool->grants.idle + 1));
}

/* Of the same numbers as the rules. The sums of grants and the number of retired places change by
 * Navigate's hand alone, so that it may read them without the lock. */
int64_t mni_pool_room(const mni_pool *pool, uint32_t table_count, uint32_t in_use) {
    int64_t k = k_in_service(pool);
    if (k >= pool->header->blocks)
        return INT32_MAX;
    if (pool->header->blocking == MN_BLOCKING_PACKED)
        return k_to_use(pool) - table_count - (int64_t)pool->grants.idle_outside;
    return k - in_use - (int64_t)pool->grants.idle;
}

double mni_pool_fill(const mni_pool *pool, uint32_t table_count, uint32_t in_use) {
    const uint32_t k = k_in_service(pool);
    if (k >= pool->header->blocks)
        return 0;
    if (pool->header->blocking == MN_BLOCKING_PACKED)
        return (double)table_count / (double)k_to_use(pool);
    return (double)in_use / (k - 1);
}

/* ---- foresight ------------------------------------------------------------------------------- */

/* NULL: no more of them. */
static mni_command *foresee(mni_pool *pool, mn_block_ref ref, uint32_t parent_id, uint32_t frames) {
    const uint32_t due = (uint32_t)pool->frame + frames,
                   at = mni_hashmap_find(&pool->ahead_by_id, ref.id);
    if (at != MNI_HASHMAP_NONE) {
        mni_command *known = &pool->ahead[at];
        known->due = due < known->due ? due : known->due;
        return known;
    }
    if (pool->ahead_count == MNI_AHEAD_MAX)
        return NULL;
    mni_hashmap_put(&pool->ahead_by_id, ref.id, pool->ahead_count);
    mni_command *command = &pool->ahead[pool->ahead_count++];
    *command = (mni_command){.kind = MNI_COMMAND_PREFETCH,
                             .places = MNI_PLACES_SPARE,
                             .ref = ref,
                             .parent_id = parent_id,
                             .sponsor = MN_NONE,
                             .due = due,
                             .frame = (uint32_t)pool->frame};
    return command;
}

void mni_pool_ahead(mni_pool *pool, mn_block_ref ref, uint32_t parent_id, uint32_t frames) {
    if (pool->prefetch == MN_PREFETCH_AHEAD)
        (void)foresee(pool, ref, parent_id, frames);
}

bool mni_pool_there_only(mni_pool *pool, bool only) {
    const bool seeks = to_come(pool) > 0;
    pool->there_only = only && seeks;
    return seeks;
}

/* As many as there are places that nobody may have in use: so whoever is sought in every frame is
 * not thrown out for another, whatever place that takes. */
bool mni_pool_seek(mni_pool *pool, uint32_t block_id) {
    if (pool->sought_count >= to_come(pool))
        return false;
    const mni_seek *seek = mni_sought_find(&pool->sought, block_id);
    const uint32_t known = pool->ahead_count;
    mni_command *command = seek != NULL ? foresee(pool, seek->ref, seek->parent_id, 0) : NULL;
    if (command != NULL)
        command->places = MNI_PLACES_ANY;
    pool->sought_count += pool->ahead_count > known;
    return true;
}

/* ---- asking ---------------------------------------------------------------------------------- */

static void attempt_begins(mni_pool *pool, uint32_t table_count, uint32_t in_use) {
    if (pool->attempt.over)
        pool->attempt = (mni_attempt){.number = pool->attempt.number + 1,
                                      .room = mni_pool_room(pool, table_count, in_use)};
}

/* The attempt asks for a block. What it had been granted before took room before it began; once it
 * has been refused that is free again, and would allow it to begin anew, for ever. */
static void attempt_asks(mni_pool *pool, uint32_t own) {
    mni_grant *grant = &pool->grants.grant[own];
    const bool packed = pool->header->blocking == MN_BLOCKING_PACKED;
    if (grant->attempt == pool->attempt.number)
        return;
    pool->attempt.room += !grant->used && (grant->outside || !packed);
    grant->attempt = pool->attempt.number;
}

static uint32_t attempt_grants(mni_pool *pool, const mni_wish *wish, uint32_t parent_id,
                               bool outside) {
    uint32_t own = mni_grants_add(&pool->grants, wish->ref, parent_id, wish->way, outside);
    if (own != MNI_HASHMAP_NONE)
        pool->grants.grant[own].attempt = pool->attempt.number;
    return own;
}

static mni_answer answer_absent(mni_pool *pool) {
    pool->attempt.absent = true;
    pool->absent_serial++;
    return MNI_ABSENT;
}

/* lacks: by how much the rule fails. What the attempt has taken up to here stands in the room that
 * it began with, so that much more would have been enough. */
static void attempt_refused(mni_pool *pool, uint32_t block_id, int64_t lacks) {
    const int64_t need = pool->attempt.room + lacks;
    pool->attempt.refused = true;
    pool->refusal = (mni_refusal){.block_id = block_id, .need = need > 1 ? (int32_t)need : 1};
}

/* own: a grant of the block's that has not been used, whose room is free when it goes. */
static mni_answer answer_refused(mni_pool *pool, const mni_wish *wish, uint32_t own,
                                 int64_t lacks) {
    const int64_t alone = mni_pool_room(pool, wish->table_count, wish->in_use) + lacks +
                          (own != MNI_HASHMAP_NONE && !pool->grants.grant[own].used);
    attempt_refused(pool, wish->ref.id, lacks);
    pool->need_alone = alone > 1 ? (int32_t)alone : 1;
    if (pool->early == 0 && wish->way == MNI_WAY_DOWN)
        mni_sought_put(&pool->sought, wish->ref, wish->parent.id);
    return MNI_REFUSED;
}

void mni_pool_refuse(mni_pool *pool, const mni_refusal *known, uint32_t table_count,
                     uint32_t in_use) {
    attempt_begins(pool, table_count, in_use);
    const int64_t lacks = known->need - mni_pool_room(pool, table_count, in_use);
    attempt_refused(pool, known->block_id, lacks > 1 ? lacks : 1);
    pool->need_alone = known->need;
}

/* packed: what is not in the table takes a place as soon as it is asked for, if it has no grant. */
bool mni_pool_has_place(const mni_pool *pool, uint32_t block_id) {
    return pool->header->blocking != MN_BLOCKING_PACKED ||
           k_in_service(pool) >= pool->header->blocks ||
           mni_grants_find(&pool->grants, block_id) != MNI_HASHMAP_NONE;
}

void mni_pool_no_room(mni_pool *pool, const mni_wish *wish, uint32_t blocks) {
    attempt_begins(pool, wish->table_count, wish->in_use);
    attempt_refused(pool, wish->ref.id,
                    blocks - mni_pool_room(pool, wish->table_count, wish->in_use));
    pool->need_alone = 1;
    MNI_TRACE(MN_TRACE_REFUSED, 0, wish->ref.id, 0);
    mni_sought_put(&pool->sought, wish->ref, wish->parent.id);
}

static bool is_there(const mni_holder *holder) {
    return holder->state == MNI_HOLDER_LOADED || holder->state == MNI_HOLDER_FREED;
}

/* Forced splits wander: a chain that lacks a block often lacks one beside it next, and that is
 * known when the first has come. So as long as places are plenty its siblings are foreseen, after
 * all else. */
static void foresee_beside(mni_pool *pool, const mni_wish *wish) {
    MN_ASSERT(pool->locked);
    const uint32_t at = mni_hashmap_find(&pool->by_id, wish->parent.id);
    if (pool->prefetch != MN_PREFETCH_AHEAD || wish->way != MNI_WAY_DOWN ||
        PLENTY_SHARE * pool->free.count < pool->holders.k || at == MNI_HASHMAP_NONE ||
        !is_there(&pool->holders.holder[at]))
        return;
    const void *bytes = mni_holders_bytes(&pool->holders, at);
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    for (uint32_t i = 0; i < frame.refs; i++) {
        const mn_block_ref ref = mni_frame_ref(bytes, i);
        if (ref.id != wish->ref.id && ref.id != 0 &&
            (uint64_t)ref.pages * MN_PAGE_BYTES <= pool->header->block_bytes_max)
            (void)foresee(pool, ref, wish->parent.id, BESIDE_FRAMES);
    }
}

/* The block is not there: grants it, if the rules allow, so that it is fetched. */
static mni_answer ask_for(mni_pool *pool, const mni_wish *wish, uint32_t slot, uint32_t own,
                          int64_t lacks) {
    MN_ASSERT(pool->locked);
    uint32_t parent_id = wish->way == MNI_WAY_OVERFLOW ? MN_NONE : wish->parent.id;
    if (pool->early > 0) {
        mni_pool_ahead(pool, wish->ref, parent_id, pool->early);
        return MNI_ABSENT; /* there may be room when it is wanted */
    }
    if (lacks > 0) {
        pool->stats.urgent_down_refused++;
        MNI_TRACE(MN_TRACE_REFUSED, 1, wish->ref.id, 0);
        return answer_refused(pool, wish, own, lacks);
    }
    if (own == MNI_HASHMAP_NONE && pool->there_only) {
        if (wish->way == MNI_WAY_DOWN) {
            mni_sought_put(&pool->sought, wish->ref, wish->parent.id);
            (void)mni_pool_seek(pool, wish->ref.id);
        }
        return MNI_ABSENT;
    }
    if (own == MNI_HASHMAP_NONE) {
        bool outside = wish->way == MNI_WAY_OVERFLOW || (wish->way == MNI_WAY_DOWN && wish->adds);
        own = attempt_grants(pool, wish, parent_id, outside);
        foresee_beside(pool, wish);
    }
    if (own != MNI_HASHMAP_NONE) { /* no room: asked again in the next frame */
        pool->grants.grant[own].asked_frame = pool->frame;
        pool->grants.grant[own].waiting = true;
        if (slot != MNI_HASHMAP_NONE)
            mni_pool_pin_locked(pool, slot, true);
    }
    return answer_absent(pool);
}

static void touch(mni_pool *pool, uint32_t slot) {
    mni_holder *holder = &pool->holders.holder[slot];
    if (holder->touched)
        return;
    MN_ASSERT(pool->touched_count < pool->holders.k);
    holder->touched = true;
    pool->touched[pool->touched_count++] = slot;
}

static void use_prefetched(mni_pool *pool, mni_holder *holder) {
    pool->stats.prefetches_used += holder->prefetched;
    if (holder->prefetched)
        MNI_TRACE(MN_TRACE_PREFETCH_USED, 0, holder->ref.id, 0);
    holder->prefetched = false;
}

static mni_answer enter_locked(mni_pool *pool, const mni_wish *wish, const void **bytes) {
    MN_ASSERT(pool->locked);
    uint32_t own = mni_grants_find(&pool->grants, wish->ref.id);
    uint32_t slot = mni_hashmap_find(&pool->by_id, wish->ref.id);
    mni_holder *holder = slot == MNI_HASHMAP_NONE ? NULL : &pool->holders.holder[slot];
    bool down = wish->way == MNI_WAY_DOWN;
    if (own != MNI_HASHMAP_NONE)
        attempt_asks(pool, own);
    if (holder == NULL || !is_there(holder))
        return ask_for(pool, wish, slot, own, down ? urgent_lacks(pool, wish, own) : 0);
    if (holder->kind != MNI_FRAME_METANODE || holder->parent_id != wish->parent.id ||
        holder->ref.pages != wish->ref.pages)
        return answer_absent(pool); /* a lying file: another block refers to it */
    bool loads = false;
    int64_t lacks = down ? down_lacks(pool, wish, own, &loads) : 0;
    if (lacks > 0) {
        if (!loads) {
            MNI_TRACE(MN_TRACE_REFUSED, 0, wish->ref.id, 0);
            return answer_refused(pool, wish, own, lacks);
        }
        if (own != MNI_HASHMAP_NONE && pool->early == 0) {
            pool->grants.grant[own].asked_frame = pool->frame;
            pool->grants.grant[own].waiting = false;
        }
        pool->waits_for_reads |= pool->early == 0;
        return answer_absent(pool);
    }
    mni_pool_rescue_locked(pool, slot);
    MN_ASSERT(!holder->used);
    holder->used = holder->held = true;
    holder->parent = wish->parent;
    holder->grandparent_id = wish->grandparent_id;
    touch(pool, slot);
    if (pool->early > 0)
        holder->ahead_frame = (uint32_t)pool->frame;
    use_prefetched(pool, holder);
    if (own != MNI_HASHMAP_NONE) {
        if (pool->early == 0) {
            pool->grants.grant[own].asked_frame = pool->frame;
            pool->grants.grant[own].waiting = false;
        }
        mni_grants_set(&pool->grants, own, true, false);
    }
    *bytes = mni_holders_bytes(&pool->holders, slot);
    return MNI_GRANTED;
}

mni_answer mni_pool_enter(mni_pool *pool, const mni_wish *wish, const void **bytes) {
    attempt_begins(pool, wish->table_count, wish->in_use);
    mni_pool_lock(pool);
    mni_answer answer = enter_locked(pool, wish, bytes);
    mni_pool_unlock(pool);
    return answer;
}

void mni_pool_attempt_over(mni_pool *pool) {
    pool->attempt.over = true;
    pool->attempt.absent = pool->attempt.refused = false;
}

void mni_pool_left(mni_pool *pool) {
    pool->attempt.over = true;
}

void mni_pool_leave(mni_pool *pool, uint32_t block_id, bool gone) {
    pool->attempt.over = true;
    mni_pool_lock(pool);
    uint32_t slot = mni_hashmap_find(&pool->by_id, block_id);
    MN_ASSERT(slot != MNI_HASHMAP_NONE);
    mni_holder *holder = &pool->holders.holder[slot];
    MN_ASSERT(holder->used && holder->held && holder->state == MNI_HOLDER_LOADED);
    holder->used = false;
    touch(pool, slot);
    bool undone = !holder->in_use;
    uint32_t own = mni_grants_find(&pool->grants, block_id);
    if (own != MNI_HASHMAP_NONE) {
        mni_grants_set(&pool->grants, own, false, gone);
        if (pool->early == 0 && pool->attempt.refused)
            pool->grants.grant[own].asked_frame = 0; /* dropped when the frame ends */
    } else if (pool->early == 0 && undone && pool->attempt.absent && !pool->attempt.refused) {
        own = mni_grants_add(&pool->grants, holder->ref, holder->parent_id, MNI_WAY_DOWN, gone);
        if (own != MNI_HASHMAP_NONE) {
            pool->grants.grant[own].asked_frame = pool->frame;
            mni_pool_pin_locked(pool, slot, true);
        }
    }
    mni_pool_unlock(pool);
}

static mni_answer overflow_locked(mni_pool *pool, const mni_wish *wish, const void **bytes) {
    MN_ASSERT(pool->locked);
    if (pool->early > 0) { /* nothing would keep it there */
        mni_pool_ahead(pool, wish->ref, MN_NONE, pool->early);
        return MNI_ABSENT;
    }
    uint32_t own = mni_grants_find(&pool->grants, wish->ref.id);
    uint32_t slot = mni_hashmap_find(&pool->by_id, wish->ref.id);
    int64_t lacks = overflow_lacks(pool, wish, own);
    if (own != MNI_HASHMAP_NONE)
        attempt_asks(pool, own);
    if (slot == MNI_HASHMAP_NONE || !is_there(&pool->holders.holder[slot]))
        return ask_for(pool, wish, slot, own, lacks);
    mni_holder *holder = &pool->holders.holder[slot];
    if (holder->kind != MNI_FRAME_OVERFLOW || holder->ref.pages != wish->ref.pages)
        return answer_absent(pool);
    if (lacks > 0) {
        MNI_TRACE(MN_TRACE_REFUSED, 0, wish->ref.id, 0);
        return answer_refused(pool, wish, own, lacks);
    }
    if (own == MNI_HASHMAP_NONE)
        own = attempt_grants(pool, wish, MN_NONE, true);
    if (own == MNI_HASHMAP_NONE)
        return answer_absent(pool);
    mni_pool_rescue_locked(pool, slot);
    mni_pool_pin_locked(pool, slot, true);
    use_prefetched(pool, holder);
    mni_grant *grant = &pool->grants.grant[own];
    grant->asked_frame = pool->frame;
    grant->waiting = false;
    grant->absent_serial = pool->absent_serial;
    *bytes = mni_holders_bytes(&pool->holders, slot);
    return MNI_GRANTED;
}

mni_answer mni_pool_overflow(mni_pool *pool, const mni_wish *wish, const void **bytes) {
    attempt_begins(pool, wish->table_count, wish->in_use);
    mni_pool_lock(pool);
    mni_answer answer = overflow_locked(pool, wish, bytes);
    mni_pool_unlock(pool);
    return answer;
}

void mni_pool_ask_root(mni_pool *pool, mn_block_ref ref) {
    mni_wish wish = {.way = MNI_WAY_DOWN, .ref = ref, .adds = true};
    mni_pool_lock(pool);
    uint32_t own = mni_grants_find(&pool->grants, ref.id);
    uint32_t slot = mni_hashmap_find(&pool->by_id, ref.id);
    (void)ask_for(pool, &wish, slot, own, 0);
    mni_pool_unlock(pool);
}

bool mni_pool_has(mni_pool *pool, uint32_t block_id) {
    mni_pool_lock(pool);
    uint32_t slot = mni_hashmap_find(&pool->by_id, block_id);
    bool has = slot != MNI_HASHMAP_NONE && is_there(&pool->holders.holder[slot]);
    mni_pool_unlock(pool);
    return has;
}

bool mni_pool_comes(mni_pool *pool, uint32_t block_id) {
    mni_pool_lock(pool);
    bool comes =
        (mni_grants_find(&pool->grants, block_id) != MNI_HASHMAP_NONE || pool->there_only) &&
        !mni_failures_has(&pool->failures, block_id);
    mni_pool_unlock(pool);
    return comes;
}

/* ---- the end of a frame: neighbours ---------------------------------------------------------- */

/* Adds to what the frame posts: false: no more room, the board's is less. */
static bool batch_add(mni_pool *pool, const mni_command *command) {
    if (pool->batch.count == pool->batch_max)
        return false;
    pool->batch.command[pool->batch.count++] = *command;
    return true;
}

/* Prefetches a neighbour of a block in use. false: there is no more room. */
static bool post_prefetch(mni_pool *pool, uint32_t sponsor, mn_block_ref ref, uint32_t parent_id) {
    const mn_header *header = pool->header;
    if (ref.id == 0 || (uint64_t)ref.pages * MN_PAGE_BYTES > header->block_bytes_max ||
        !mni_failures_due(&pool->failures, ref.id, pool->frame))
        return true;
    mni_command command = {.kind = MNI_COMMAND_PREFETCH,
                           .ref = ref,
                           .parent_id = parent_id,
                           .sponsor = sponsor,
                           .sponsor_generation = pool->holders.holder[sponsor].generation};
    return batch_add(pool, &command);
}

/* The block has come into use: its parent and its children are counted once more, and those that
 * are not there are fetched. Raising the count of an absent block is the prefetch. */
static void raise_neighbours(mni_pool *pool, uint32_t slot) {
    MN_ASSERT(pool->locked);
    const mni_holder *holder = &pool->holders.holder[slot];
    const void *bytes = mni_holders_bytes(&pool->holders, slot);
    bool room = true;
    mni_frame frame;
    mni_frame_get(bytes, &frame);

    uint32_t at = mni_hashmap_find(&pool->by_id, holder->parent.id);
    if (at != MNI_HASHMAP_NONE && is_there(&pool->holders.holder[at])) {
        pool->holders.holder[at].children_in_use++;
        mni_pool_rescue_locked(pool, at);
    } else if (at == MNI_HASHMAP_NONE && holder->parent.id != 0) {
        room = post_prefetch(pool, slot, holder->parent, holder->grandparent_id);
    }
    for (uint32_t i = 0; i < frame.refs; i++) {
        mn_block_ref ref = mni_frame_ref(bytes, i);
        at = mni_hashmap_find(&pool->by_id, ref.id);
        if (at == MNI_HASHMAP_NONE) {
            room = room && post_prefetch(pool, slot, ref, holder->ref.id);
            continue;
        }
        mni_holder *child = &pool->holders.holder[at];
        if (is_there(child) && child->parent_id == holder->ref.id) {
            child->parent_in_use = true;
            mni_pool_rescue_locked(pool, at);
        }
    }
}

static void lower_neighbours(mni_pool *pool, uint32_t slot) {
    MN_ASSERT(pool->locked);
    const mni_holder *holder = &pool->holders.holder[slot];
    const void *bytes = mni_holders_bytes(&pool->holders, slot);
    mni_frame frame;
    mni_frame_get(bytes, &frame);

    uint32_t at = mni_hashmap_find(&pool->by_id, holder->parent.id);
    if (at != MNI_HASHMAP_NONE && is_there(&pool->holders.holder[at])) {
        MN_ASSERT(pool->holders.holder[at].children_in_use > 0);
        pool->holders.holder[at].children_in_use--;
        mni_pool_release_locked(pool, at);
    }
    for (uint32_t i = 0; i < frame.refs; i++) {
        at = mni_hashmap_find(&pool->by_id, mni_frame_ref(bytes, i).id);
        if (at == MNI_HASHMAP_NONE)
            continue;
        mni_holder *child = &pool->holders.holder[at];
        if (is_there(child) && child->parent_id == holder->ref.id) {
            child->parent_in_use = false;
            mni_pool_release_locked(pool, at);
        }
    }
}

static void settle_touched(mni_pool *pool) {
    MN_ASSERT(pool->locked);
    bool changed = false;
    for (uint32_t i = 0; i < pool->touched_count; i++) {
        uint32_t slot = pool->touched[i];
        mni_holder *holder = &pool->holders.holder[slot];
        MN_ASSERT(holder->touched && holder->held);
        holder->touched = false;
        holder->held = holder->used;
        changed |= holder->used != holder->in_use;
        bool count = pool->prefetch == MN_PREFETCH_NEIGHBOURS;
        if (holder->used && !holder->in_use) {
            holder->in_use = true;
            if (count)
                raise_neighbours(pool, slot);
        } else if (!holder->used && holder->in_use) {
            holder->in_use = false;
            if (count)
                lower_neighbours(pool, slot);
        }
        if (!holder->used)
            mni_pool_release_locked(pool, slot);
    }
    pool->touched_count = 0;
    pool->epoch += changed;
}

/* ---- the end of a frame: grants -------------------------------------------------------------- */

static void post_urgent(mni_pool *pool, uint32_t index) {
    mni_grant *grant = &pool->grants.grant[index];
    mni_command command = {.kind = grant->way == MNI_WAY_UP ? MNI_COMMAND_URGENT_UP
                                                            : MNI_COMMAND_URGENT_DOWN,
                           .ref = grant->ref,
                           .parent_id = grant->parent_id,
                           .sponsor = index,
                           .sponsor_generation = grant->serial,
                           .notes = grant->notes};
    grant->posted = batch_add(pool, &command);
}

/* Navigate has used it, or nobody has asked for it again: the grant goes, and its pin. */
static bool is_over(const mni_pool *pool, const mni_grant *grant) {
    bool handed_over = grant->way == MNI_WAY_OVERFLOW && !grant->waiting;
    return grant->used || grant->asked_frame != pool->frame ||
           (handed_over && grant->absent_serial == pool->absent_serial);
}

static void settle_grants(mni_pool *pool) {
    MN_ASSERT(pool->locked);
    for (uint32_t i = 0; i < pool->grants.high; i++) {
        mni_grant *grant = &pool->grants.grant[i];
        if (grant->ref.id == 0)
            continue;
        uint32_t slot = mni_hashmap_find(&pool->by_id, grant->ref.id);
        if (is_over(pool, grant)) {
            mni_grants_remove(&pool->grants, i);
            if (slot != MNI_HASHMAP_NONE && pool->holders.holder[slot].pinned) {
                mni_pool_pin_locked(pool, slot, false);
                mni_pool_release_locked(pool, slot);
            }
        } else if (slot == MNI_HASHMAP_NONE && !grant->posted &&
                   mni_failures_due(&pool->failures, grant->ref.id, pool->frame)) {
            post_urgent(pool, i);
        }
    }
}

uint32_t mni_pool_begin_frame(mni_pool *pool, mni_report report[MNI_REPORTS_MAX]) {
    pool->waits_for_reads = false;
    mni_pool_lock(pool);
    pool->frame++;
    uint32_t count = pool->reports;
    for (uint32_t i = 0; i < count; i++)
        report[i] = pool->report[i];
    pool->reports = 0;
    mni_pool_unlock(pool);
    return count;
}

/* ---- the end of a frame: foresight ----------------------------------------------------------- */

/* Grants come, go and are noted on by Navigate alone: so it may look for them without the lock. */
void mni_pool_note(mni_pool *pool, uint32_t block_id, const mni_note *note) {
    uint32_t at = mni_hashmap_find(&pool->ahead_by_id, block_id);
    if (at != MNI_HASHMAP_NONE)
        mni_notes_add(&pool->ahead[at].notes, note);
    at = mni_grants_find(&pool->grants, block_id);
    if (at != MNI_HASHMAP_NONE)
        mni_notes_add(&pool->grants.grant[at].notes, note);
}

void mni_pool_early(mni_pool *pool, uint32_t frames) {
    if (pool->prefetch == MN_PREFETCH_AHEAD)
        pool->early = frames;
}

/* What is there is kept longest, and looked into; what is not is fetched. */
static void settle_ahead(mni_pool *pool) {
    MN_ASSERT(pool->locked);
    for (uint32_t i = 0; i < pool->ahead_count; i++) {
        mni_command *command = &pool->ahead[i];
        uint32_t slot = mni_hashmap_find(&pool->by_id, command->ref.id);
        if (slot == MNI_HASHMAP_NONE) {
            if (mni_failures_due(&pool->failures, command->ref.id, pool->frame))
                (void)batch_add(pool, command);
        } else {
            mni_pool_foresee_locked(pool, slot);
            command->kind = MNI_COMMAND_LOOK;
            if (command->notes.count > 0)
                (void)batch_add(pool, command);
        }
        mni_hashmap_remove(&pool->ahead_by_id, command->ref.id);
    }
    pool->ahead_count = pool->sought_count = 0;
}

/* ---- the end of a frame ---------------------------------------------------------------------- */

/* The whole frame's commands under one lock. Urgent ones for which the board has no room are posted
 * with the next frame's. */
static void post_batch(mni_pool *pool, bool goes_on) {
    mni_batch *batch = &pool->batch;
    batch->cancel_before = 0;
    batch->goes_on = goes_on;
    if (pool->frame > MNI_AHEAD_FRAMES)
        batch->cancel_before = (uint32_t)(pool->frame - MNI_AHEAD_FRAMES);
    uint32_t rejected = mni_board_post(pool->board, batch);
    batch->count = 0;
    if (rejected == 0)
        return;
    mni_pool_lock(pool);
    for (uint32_t i = 0; i < rejected; i++)
        pool->grants.grant[batch->command[i].sponsor].posted = false;
    mni_pool_unlock(pool);
}

static void trace_levels(const mni_pool *pool) {
    MNI_TRACE_COUNT(MN_TRACE_N_FREE, pool->free.count);
    MNI_TRACE_COUNT(MN_TRACE_N_EMPTY, pool->holders.count[MNI_HOLDER_EMPTY]);
    MNI_TRACE_COUNT(MN_TRACE_N_LOADING, pool->holders.count[MNI_HOLDER_LOADING]);
    MNI_TRACE_COUNT(MN_TRACE_N_LOADED, pool->holders.count[MNI_HOLDER_LOADED]);
}

void mni_pool_end_frame(mni_pool *pool) {
    pool->attempt.over = true;
    mni_pool_lock(pool);
    settle_grants(pool); /* first: urgent commands stand before prefetches in a batch, and what is
                            unpinned may be freed once */
    settle_touched(pool);
    settle_ahead(pool);
    trace_levels(pool);
    mni_pool_unlock(pool);
    post_batch(pool, false);
}

void mni_pool_post(mni_pool *pool) {
    mni_pool_lock(pool);
    for (uint32_t i = 0; i < pool->grants.high; i++) {
        const mni_grant *grant = &pool->grants.grant[i];
        if (grant->ref.id != 0 && grant->asked_frame == pool->frame && !grant->posted &&
            mni_hashmap_find(&pool->by_id, grant->ref.id) == MNI_HASHMAP_NONE &&
            mni_failures_due(&pool->failures, grant->ref.id, pool->frame))
            post_urgent(pool, i);
    }
    mni_pool_unlock(pool);
    if (pool->batch.count > 0)
        post_batch(pool, true);
}

/* ---- figures --------------------------------------------------------------------------------- */

uint32_t mni_pool_waiting(mni_pool *pool) {
    uint32_t count = pool->waits_for_reads;
    mni_pool_lock(pool);
    for (uint32_t i = 0; i < pool->grants.high; i++) {
        const mni_grant *grant = &pool->grants.grant[i];
        if (grant->ref.id != 0 && grant->waiting &&
            mni_failures_due(&pool->failures, grant->ref.id, pool->frame + 1))
            count++;
    }
    mni_pool_unlock(pool);
    return count;
}

uint32_t mni_pool_resident(mni_pool *pool) {
    mni_pool_lock(pool);
    uint32_t resident = pool->holders.count[MNI_HOLDER_LOADED];
    mni_pool_unlock(pool);
    return resident;
}

void mni_pool_stats(mni_pool *pool, mn_session_stats *out) {
    mni_pool_lock(pool);
    *out = pool->stats;
    out->io_lock_hold_ns_max = pool->lock.held_ns_max;
    mni_pool_unlock(pool);
}

/* ---- chunks ---------------------------------------------------------------------------------- */

static uint32_t chunk_end(const mni_holders *holders, uint32_t chunk) {
    uint64_t end = ((uint64_t)chunk + 1) * holders->chunk_holders;
    return end < holders->k ? (uint32_t)end : holders->k;
}

static bool chunk_may_retire(const mni_pool *pool, uint32_t chunk) {
    const mni_holders *holders = &pool->holders;
    for (uint32_t slot = chunk * holders->chunk_holders; slot < chunk_end(holders, chunk); slot++) {
        const mni_holder *holder = &holders->holder[slot];
        if (holder->state == MNI_HOLDER_LOADING || holder->state == MNI_HOLDER_RETIRED ||
            holder->held || holder->in_use || holder->pinned || slot == pool->looked_at)
            return false;
    }
    return true;
}

bool mni_pool_shrink(mni_pool *pool, uint32_t table_count, uint32_t *chunk) {
    mni_holders *holders = &pool->holders;
    bool found = false;
    mni_pool_lock(pool);
    /* What the rules have granted must still fit: A for packed, and more than U for levels. */
    uint64_t need = (uint64_t)table_count + pool->grants.idle + URGENT_DOWN_SPARE;
    uint32_t k_min = mni_store_k_min(pool->header);
    need = need > k_min ? need : k_min;
    for (uint32_t c = holders->chunks; !found && c-- > 0;) {
        uint32_t from = c * holders->chunk_holders, to = chunk_end(holders, c);
        if (!chunk_may_retire(pool, c) || k_in_service(pool) < need + (to - from))
            continue;
        found = true;
        *chunk = c;
        for (uint32_t slot = from; slot < to; slot++) {
            if (holders->holder[slot].state != MNI_HOLDER_LOADED)
                mni_freelist_unlink(&pool->free, holders, slot);
            else
                pool->stats.evictions++;
            mni_pool_forget_locked(pool, slot);
            mni_holders_set(holders, slot, MNI_HOLDER_RETIRED);
        }
        serve(pool);
    }
    mni_pool_unlock(pool);
    return found;
}

bool mni_pool_retired(mni_pool *pool, uint32_t *chunk) {
    mni_holders *holders = &pool->holders;
    bool found = false;
    mni_pool_lock(pool);
    for (uint32_t c = 0; !found && c < holders->chunks; c++) {
        found = holders->holder[c * holders->chunk_holders].state == MNI_HOLDER_RETIRED;
        *chunk = c;
    }
    mni_pool_unlock(pool);
    return found;
}

void mni_pool_grow(mni_pool *pool, uint32_t chunk) {
    mni_holders *holders = &pool->holders;
    mni_pool_lock(pool);
    for (uint32_t slot = chunk * holders->chunk_holders; slot < chunk_end(holders, chunk); slot++) {
        mni_holders_set(holders, slot, MNI_HOLDER_EMPTY);
        mni_freelist_prepend(&pool->free, holders, slot);
    }
    pool->epoch++;
    serve(pool);
    mni_pool_unlock(pool);
}
