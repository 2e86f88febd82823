/* Goal: a chain that was refused is tried again when it may have room, and not before; whoever
 * comes by the same node is refused unseen; and in a pool that is full what is in memory has its
 * turn before what is absent, which is fetched meanwhile. Method: each function alone, with a
 * navigator over a pool of a part of the file, whose fields are set to what a pass of splits would
 * have left there; and a flight in a pool that is too small, with every wanted node counted anew.
 */
#include <check.h>

#include "flight.h"
#include "frame.h"
#include "refusals.h"
#include "suite.h"

enum { NO_BLOCK = 1 << 30, MUCH = 1 << 20, PLACES = 2 }; /* for what is to come */

static model made;

static void make(void) {
    const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    model_make(&made, MODEL_TERRAIN, 30000, &blocks);
}

static void gone(void) {
    model_free(&made);
}

/* Over a part of the file, of which a sixteenth is for what is to come. */
static void open_with(flight *f, uint32_t more) {
    const mn_header *header = &made.header;
    *f = (flight){.m = made, .limits = mni_block_limits_of(header)};
    const uint32_t k = mni_store_k_min(header) + more;
    ck_assert_uint_lt(k, header->blocks);
    flight_open(f, k, (mni_store_desc){.io = MN_IO_SIM}, NODES_MAX);
    ck_assert_uint_eq(k - mni_store_k_to_use(header, k, MN_PREFETCH_AHEAD), more / 16);
}

static void close_it(flight *f) { /* the model stays */
    mni_store_close(f->store);
    mni_arena_close(&f->arena);
}

/* From some way off, at rest: there is room in the pool, and most blocks are absent. */
static mni_navigator *at_rest(flight *f) {
    const mn_camera camera = model_camera(&made, 0, 2);
    const mni_refusal little = {NO_BLOCK, 4};
    open_with(f, 16 * PLACES);
    for (int i = 0; i < 10; i++)
        flight_frame(f, &camera, 6);
    ck_assert(mni_store_allows(f->store, &little, false));
    f->nav.moved = f->nav.lenient = f->nav.again = f->nav.seeks = false;
    return &f->nav;
}

/* An inner node that stands, the next after a slot. */
static uint32_t next_inner(const mni_front *front, uint32_t slot) {
    do
        slot++;
    while (slot < front->slots_high &&
           (!mni_front_is_active(front, slot) || mni_front_is_leaf(front, slot)));
    ck_assert_uint_lt(slot, front->slots_high);
    return slot;
}

static uint32_t any_inner(const mni_front *front) {
    return next_inner(front, UINT32_MAX);
}

static void set_refused(mni_navigator *nav, uint32_t slot, uint32_t block_id, int32_t need) {
    nav->front.node[slot].flags |= MNI_NODE_GIVEN_UP;
    nav->refusal[slot] = (mni_refusal){block_id, need};
}

static bool is_refused(const mni_navigator *nav, uint32_t slot) {
    return (nav->front.node[slot].flags & MNI_NODE_GIVEN_UP) != 0;
}

/* An entry in use, after that one; MNI_NO_ENTRY: there is no other. */
static mni_entry next_used(const flight *f, mni_entry entry, uint32_t k) {
    const uint32_t max = mni_store_entries_max(&made.header, MN_STORE_PAGED, k);
    for (entry++; entry < max; entry++)
        if (mni_store_usage(f->store, entry) > 0)
            return entry;
    return MNI_NO_ENTRY;
}

static uint32_t used_block(const flight *f) {
    const uint32_t k = mni_store_k_min(&made.header) + 16 * PLACES;
    return mni_store_block_id(f->store, next_used(f, UINT32_MAX, k));
}

/* ---- when is one tried again? ---------------------------------------------------------------- */

/* It stands refused as long as there is less room than it needs and its block is in no entry. */
START_TEST(stands_until_there_is_room) {
    flight f;
    mni_navigator *nav = at_rest(&f);
    const uint32_t slot = any_inner(&nav->front), used = used_block(&f);
    const mni_refusal refusals[] = {{NO_BLOCK, MUCH}, {NO_BLOCK, 1}, {used, MUCH}};
    nav->refusal[slot] = refusals[0];
    ck_assert(!mni_refusals_stands(nav, slot)); /* nobody was refused */
    ck_assert(!mni_refusals_has(nav, slot));
    for (int i = 0; i < 3; i++) {
        const mni_barred_node node = {.item = {.what = slot}, .refusal = refusals[i]};
        set_refused(nav, slot, refusals[i].block_id, refusals[i].need);
        ck_assert(mni_refusals_has(nav, slot));
        ck_assert(mni_refusals_stands(nav, slot) == (i == 0));
        ck_assert(mni_refusals_stands_barred(nav, &node) == (i == 0));
    }
    set_refused(nav, slot, 0, 0);
    ck_assert(!mni_refusals_has(nav, slot));
    close_it(&f);
}
END_TEST

/* Who was refused for no block that is known is tried when anything has changed since the pass
 * before: the camera, the front, or the blocks in use. */
START_TEST(unknown_until_something_changes) {
    flight f;
    mni_navigator *nav = at_rest(&f);
    const uint32_t slot = any_inner(&nav->front);
    set_refused(nav, slot, 0, 0);
    for (int trial = 0; trial < 3; trial++) {
        nav->moved = false;
        nav->version = nav->front.version;
        mni_refusals_begin(nav);
        mni_refusals_begin(nav); /* what has changed before is known by now */
        ck_assert(mni_refusals_stands(nav, slot));
        nav->moved = trial == 0;
        nav->version -= trial == 1;
        nav->epoch -= trial == 2;
        mni_refusals_begin(nav);
        ck_assert_msg(!mni_refusals_stands(nav, slot), "trial %d", trial);
    }
    close_it(&f);
}
END_TEST

/* Of the order ids from 0, which do not stand though they need more room than there is: a bit each.
 */
static uint32_t tried(mni_navigator *nav, uint32_t slot) {
    uint32_t bits = 0;
    for (uint32_t order = 0; order < MNI_TURNS; order++) {
        const mni_barred_node node = {.item = {.order = order}, .refusal = {NO_BLOCK, MUCH}};
        nav->front.node[slot].order = order;
        const bool stands = mni_refusals_stands(nav, slot);
        ck_assert(stands == mni_refusals_stands_barred(nav, &node));
        bits |= (uint32_t)!stands << order;
    }
    return bits;
}

/* With less room than it needs each is tried in one frame of MNI_TURNS while the camera moves; when
 * it stands and blocks have come into use or have gone, all are; and otherwise none. */
START_TEST(each_has_its_turn) {
    flight f;
    mni_navigator *nav = at_rest(&f);
    const uint32_t slot = any_inner(&nav->front), order = nav->front.node[slot].order;
    uint32_t all = 0;
    set_refused(nav, slot, NO_BLOCK, MUCH);
    mni_refusals_begin(nav);
    for (int i = 0; i < 2 * MNI_TURNS; i++) {
        nav->moved = true;
        nav->epoch -= i % 2; /* which changes nothing */
        mni_refusals_begin(nav);
        const uint32_t now = tried(nav, slot);
        ck_assert_int_eq(__builtin_popcount(now), 1);
        ck_assert((all & now) == 0);
        all |= now;
        nav->moved = false;
        nav->epoch--;
        mni_refusals_begin(nav);
        ck_assert_uint_eq(tried(nav, slot), UINT32_MAX >> (32 - MNI_TURNS));
        for (int j = 2; j < MNI_TURNS; j++, all = 0) {
            mni_refusals_begin(nav);
            ck_assert_uint_eq(tried(nav, slot), 0);
        }
    }
    for (int i = 0; i < MNI_TURNS; i++) {
        nav->moved = true;
        mni_refusals_begin(nav);
        all |= tried(nav, slot);
    }
    ck_assert_uint_eq(all, UINT32_MAX >> (32 - MNI_TURNS));
    nav->front.node[slot].order = order;
    close_it(&f);
}
END_TEST

/* ---- what is remembered ---------------------------------------------------------------------- */

/* Makes splits until one of them has brought another block into use. */
static void bring_in(flight *f) {
    mni_front *front = &f->nav.front;
    const uint32_t before = mni_store_with_ancestors(f->store);
    uint32_t branch;
    for (uint32_t slot = any_inner(front);; slot = next_inner(front, slot)) {
        if (mni_front_split_blocker(front, slot) != MN_NONE)
            continue;
        mni_store_attempt_over(f->store);
        if (mni_front_split(front, slot, &branch) == MNI_DONE &&
            mni_store_with_ancestors(f->store) > before)
            return;
    }
}

/* Whoever was refused needs what his chain would have had to begin with; whoever is on the way to
 * where that happened needs that block at least, and what is known better of him stays. Who is not
 * on the way, or stands no more, is not refused. */
START_TEST(what_is_remembered) {
    enum { ON_THE_WAY = 5 };
    flight f;
    mni_navigator *nav = at_rest(&f);
    const mni_refusal known = {NO_BLOCK, MUCH};
    uint32_t slot[ON_THE_WAY], at = UINT32_MAX;
    bring_in(&f);
    for (int i = 0; i < ON_THE_WAY; i++) {
        slot[i] = at = next_inner(&nav->front, at);
        nav->front.node[at].flags = 0;
        nav->stack[i] = mni_front_ref_of(&nav->front, at);
    }
    ck_assert_uint_eq(mni_store_refusal(f.store, true).block_id, 0); /* not known */
    nav->pusher[0] = MNI_NOBODY;
    mni_refusals_put_on_the_way(nav, 0);
    ck_assert(!is_refused(nav, slot[0]));

    mni_store_refuse(f.store, &known);
    const int32_t whole = mni_store_refusal(f.store, false).need;
    ck_assert_int_gt(whole, MUCH);
    mni_refusals_put(nav, slot[4]);
    ck_assert(is_refused(nav, slot[4]));
    ck_assert_uint_eq(nav->refusal[slot[4]].block_id, NO_BLOCK);
    ck_assert_int_eq(nav->refusal[slot[4]].need, whole);

    /* 4 was pushed for 3, which has been split meanwhile, that for 1, and that for 0 */
    nav->pusher[1] = nav->pusher[2] = 0;
    nav->pusher[3] = 1;
    nav->pusher[4] = 3;
    nav->stack[3].order++;
    set_refused(nav, slot[1], NO_BLOCK + 1, 7);
    nav->refusal[slot[0]] = (mni_refusal){NO_BLOCK, 5}; /* of who was there before */
    mni_refusals_put_on_the_way(nav, 4);
    ck_assert_int_eq(nav->refusal[slot[4]].need, whole);
    for (int i = 0; i < 2; i++) {
        ck_assert(is_refused(nav, slot[i]));
        ck_assert_uint_eq(nav->refusal[slot[i]].block_id, NO_BLOCK);
        ck_assert_int_eq(nav->refusal[slot[i]].need, MUCH);
    }
    ck_assert(!is_refused(nav, slot[2]) && !is_refused(nav, slot[3]));
    close_it(&f);
}
END_TEST

/* A chain that comes to a blocker which was refused, for a block that is known, and would be again,
 * is refused as that was. */
START_TEST(refused_at_a_blocker) {
    enum { BELOW, FREE, ALLOWED, UNKNOWN, REFUSED, STACKED };
    flight f;
    mni_navigator *nav = at_rest(&f);
    uint32_t slot[STACKED], at = UINT32_MAX;
    for (int i = 0; i < STACKED; i++) {
        slot[i] = at = next_inner(&nav->front, at);
        nav->front.node[at].flags = 0;
        nav->stack[i] = mni_front_ref_of(&nav->front, at);
    }
    set_refused(nav, slot[BELOW], NO_BLOCK + 1, MUCH);
    set_refused(nav, slot[ALLOWED], NO_BLOCK + 1, 1);
    set_refused(nav, slot[UNKNOWN], 0, 0);
    set_refused(nav, slot[REFUSED], NO_BLOCK, MUCH);
    for (uint32_t pushed = 0; pushed <= REFUSED - FREE; pushed++)
        ck_assert(!mni_refusals_bar(nav, FREE, pushed));
    ck_assert_uint_eq(mni_store_refusal(f.store, true).block_id, 0);
    for (uint32_t top = FREE; top <= REFUSED; top++) {
        mni_store_refuse(f.store, &(mni_refusal){NO_BLOCK + 2, 9});
        ck_assert(mni_refusals_bar(nav, top, REFUSED + 1 - top));
        ck_assert_uint_eq(mni_store_refusal(f.store, true).block_id, NO_BLOCK);
        ck_assert_int_eq(mni_store_refusal(f.store, true).need, MUCH);
    }
    close_it(&f);
}
END_TEST

/* ---- first what is there --------------------------------------------------------------------- */

/* Only what is there has its turn: then who was refused for a block that is absent lacks it. */
START_TEST(lacks_what_is_absent) {
    flight f;
    mni_navigator *nav = at_rest(&f);
    const uint32_t slot = any_inner(&nav->front);
    for (int there_only = 0; there_only < 2; there_only++) {
        nav->there_only = there_only == 1;
        nav->front.node[slot].flags &= 7 & ~MNI_NODE_GIVEN_UP;
        nav->refusal[slot] = (mni_refusal){NO_BLOCK, MUCH};
        ck_assert(!mni_refusals_lacks(nav, slot));
        set_refused(nav, slot, NO_BLOCK, MUCH);
        ck_assert(mni_refusals_lacks(nav, slot) == nav->there_only);
        set_refused(nav, slot, used_block(&f), MUCH);
        ck_assert(!mni_refusals_lacks(nav, slot));
        set_refused(nav, slot, 0, 0);
        ck_assert(!mni_refusals_lacks(nav, slot));
    }
    close_it(&f);
}
END_TEST

static void learn_a_lack(mni_navigator *nav) {
    mni_lacking_chain(&nav->lacking);
    mni_lacking_put(&nav->lacking, 7, 3, false);
    ck_assert_ptr_nonnull(mni_lacking_of(&nav->lacking, 7));
}

static mni_agenda_item item_of(uint32_t key) {
    return (mni_agenda_item){.order = key, .key = key, .what = key};
}

static uint32_t popped(mni_navigator *nav) {
    mni_agenda_item item = {0};
    ck_assert(mni_agenda_pop(&nav->agenda, &item));
    return item.key;
}

static void agenda_anew(mni_navigator *nav) {
    mni_agenda_clear(&nav->agenda);
    mni_agenda_begin(&nav->agenda);
}

/* Who is put off has his turn after all others that are there; then all who have been put off, by
 * falling error. Nobody who waits is lost. */
START_TEST(put_off_till_the_others_are_through) {
    flight f;
    mni_agenda_item item;
    mni_navigator *nav = at_rest(&f);
    agenda_anew(nav);
    mni_refusals_begin(nav);
    ck_assert(!nav->there_only); /* the frame before had room */
    ck_assert(!mni_refusals_wait(nav, item_of(5)));
    nav->seeks = true;
    mni_refusals_begin(nav);
    ck_assert(nav->there_only);
    mni_refusals_put_off(nav, item_of(11));
    mni_refusals_put_off(nav, item_of(10));
    mni_agenda_push(&nav->agenda, item_of(12));
    ck_assert_uint_eq(popped(nav), 12);
    ck_assert(!mni_refusals_wait(nav, item_of(12)) && nav->there_only);
    ck_assert(mni_agenda_pop(&nav->agenda, &item));
    ck_assert_uint_eq(item.order, 10);
    learn_a_lack(nav);
    ck_assert(mni_refusals_wait(nav, item) && !nav->there_only);
    ck_assert_ptr_null(mni_lacking_of(&nav->lacking, 7)); /* which may be granted now */
    ck_assert_uint_eq(popped(nav), 10);
    ck_assert(!mni_refusals_wait(nav, item_of(10)));
    ck_assert_uint_eq(popped(nav), 11);
    ck_assert(!mni_agenda_pop(&nav->agenda, &item));
    close_it(&f);
}
END_TEST

/* When as many blocks are sought as there are places for, what is absent has its turn from there
 * on. */
START_TEST(enough_is_sought) {
    flight f;
    mni_navigator *nav = at_rest(&f);
    agenda_anew(nav);
    nav->seeks = true;
    mni_refusals_begin(nav);
    mni_refusals_put_off(nav, item_of(10));
    nav->seeks = false;
    ck_assert(mni_refusals_wait(nav, item_of(20)) && !nav->there_only);
    ck_assert_uint_eq(popped(nav), 10);
    ck_assert(!mni_refusals_wait(nav, item_of(10)));
    ck_assert_uint_eq(popped(nav), 20);
    close_it(&f);
}
END_TEST

/* What a pass has found absent is forgotten with the next one; and its end is the end of what is
 * there only, too. */
START_TEST(a_pass_begins_and_ends) {
    flight f;
    mni_navigator *nav = at_rest(&f);
    agenda_anew(nav);
    learn_a_lack(nav);
    mni_refusals_begin(nav);
    ck_assert_ptr_null(mni_lacking_of(&nav->lacking, 7));
    nav->seeks = true;
    mni_refusals_begin(nav);
    ck_assert(nav->there_only && nav->seeks);
    mni_refusals_end(nav);
    ck_assert(!nav->there_only);
    close_it(&f);
    open_with(&f, 15); /* no place is left for what is to come */
    f.nav.seeks = true;
    mni_refusals_begin(&f.nav);
    ck_assert(!f.nav.there_only);
    close_it(&f);
}
END_TEST

/* ---- what is absent is sought ---------------------------------------------------------------- */

typedef struct absent_child {
    mni_entry parent;
    mn_block_ref ref;
} absent_child;

static bool has(const flight *f, uint32_t block_id) {
    return mni_store_has(f->store, &(mni_refusal){block_id, 1});
}

/* Children of blocks in use that are not in memory. */
static void find_absent(flight *f, absent_child *child, int count) {
    const uint32_t k = mni_store_k_min(&made.header) + 16 * PLACES;
    mni_entry entry = UINT32_MAX;
    int found = 0;
    bool fresh;
    while (found < count && (entry = next_used(f, entry, k)) != MNI_NO_ENTRY) {
        const void *bytes = mni_store_bytes(f->store, entry, &fresh);
        mni_frame frame;
        mni_frame_get(bytes, &frame);
        for (uint32_t i = 0; i < frame.refs && found < count; i++)
            if (!has(f, mni_frame_ref(bytes, i).id))
                child[found++] = (absent_child){entry, mni_frame_ref(bytes, i)};
    }
    ck_assert_int_eq(found, count);
}

static mni_answer ask(flight *f, const absent_child *child) {
    mni_entry entry;
    const mni_answer answer = mni_store_down(f->store, child->parent, child->ref, &entry);
    mni_store_attempt_over(f->store);
    return answer;
}

static uint64_t granted(flight *f) {
    mn_session_stats stats = {0};
    mni_store_stats(f->store, &stats);
    return stats.urgent_down;
}

static void frames_pass(flight *f, int frames) {
    while (frames-- > 0) {
        mni_store_frame_end(f->store, 1.0 / 60);
        mni_store_frame_begin(f->store);
    }
}

/* Where only what is there has its turn, what is absent is granted nothing; after it, it is. */
START_TEST(no_grant_for_what_is_absent) {
    flight f;
    absent_child child[2];
    mni_navigator *nav = at_rest(&f);
    find_absent(&f, child, 2);
    const uint64_t before = granted(&f);
    mni_store_frame_begin(f.store);
    nav->seeks = true;
    mni_refusals_begin(nav);
    agenda_anew(nav);
    ck_assert_int_eq(ask(&f, &child[0]), MNI_ABSENT);
    mni_refusals_end(nav);
    frames_pass(&f, 1);
    ck_assert_uint_eq(granted(&f), before);
    nav->seeks = false;
    mni_refusals_begin(nav);
    ck_assert_int_eq(ask(&f, &child[1]), MNI_ABSENT);
    mni_refusals_end(nav);
    frames_pass(&f, 1);
    ck_assert_uint_eq(granted(&f), before + 1);
    nav->seeks = true;
    mni_refusals_begin(nav);
    mni_refusals_put_off(nav, item_of(1));
    ck_assert(mni_refusals_wait(nav, (mni_agenda_item){1, 1 | MNI_PUT_OFF, 1}));
    find_absent(&f, child, 1);
    ck_assert_int_eq(ask(&f, &child[0]), MNI_ABSENT);
    frames_pass(&f, 1);
    ck_assert_uint_eq(granted(&f), before + 2);
    close_it(&f);
}
END_TEST

/* What somebody was refused for is fetched, as many blocks as there are places for; and nothing
 * where places are not scarce. */
START_TEST(sought_as_there_are_places) {
    flight f;
    absent_child child[PLACES + 2];
    mni_navigator *nav = at_rest(&f);
    find_absent(&f, child, PLACES + 2);
    mni_store_frame_begin(f.store);
    nav->seeks = true;
    mni_refusals_begin(nav);
    for (int i = 0; i < PLACES + 2; i++) { /* which makes them known, and seeks the first */
        mni_refusals_seek(nav, &(mni_refusal){NO_BLOCK, 1});
        ck_assert(nav->seeks == (i < PLACES));
        ck_assert_int_eq(ask(&f, &child[i]), MNI_ABSENT);
    }
    mni_refusals_seek(nav, &(mni_refusal){child[PLACES].ref.id, 1});
    mni_refusals_end(nav);
    frames_pass(&f, 20);
    for (int i = 0; i < PLACES + 2; i++)
        ck_assert(has(&f, child[i].ref.id) == (i < PLACES));
    mni_refusals_seek(nav, &(mni_refusal){child[PLACES].ref.id, 1});
    ck_assert(!nav->seeks); /* nor is it now: places were no longer scarce */
    frames_pass(&f, 20);
    ck_assert(!has(&f, child[PLACES].ref.id));
    nav->seeks = true;
    mni_refusals_seek(nav, &(mni_refusal){child[PLACES].ref.id, 1});
    ck_assert(nav->seeks);
    frames_pass(&f, 20);
    ck_assert(has(&f, child[PLACES].ref.id));
    ck_assert(!has(&f, child[PLACES + 1].ref.id));
    close_it(&f);
}
END_TEST

/* The next to have room is who needs one place more than there is. Who needs several waits longer,
 * and is not sought in his stead. */
START_TEST(who_needs_several_is_not_sought) {
    flight f;
    absent_child child[PLACES + 2];
    mni_navigator *nav = at_rest(&f);
    find_absent(&f, child, PLACES + 2);
    nav->seeks = true;
    mni_refusals_begin(nav);
    for (int i = 0; i < PLACES + 2; i++) /* which makes them known, and seeks the first */
        ck_assert_int_eq(ask(&f, &child[i]), MNI_ABSENT);
    mni_refusals_end(nav);
    frames_pass(&f, 1);
    const int32_t next = (int32_t)mni_store_room(f.store) + 1;
    ck_assert_int_gt(next, 0);
    mni_refusals_seek(nav, &(mni_refusal){child[PLACES].ref.id, next + 1});
    mni_refusals_seek(nav, &(mni_refusal){child[PLACES].ref.id, INT32_MAX});
    mni_refusals_seek(nav, &(mni_refusal){child[PLACES + 1].ref.id, next});
    ck_assert(nav->seeks);
    frames_pass(&f, 20);
    ck_assert(!has(&f, child[PLACES].ref.id));
    ck_assert(has(&f, child[PLACES + 1].ref.id));
    close_it(&f);
}
END_TEST

/* ---- a flight in a full pool ----------------------------------------------------------------- */

/* With the camera going round there are always others that are wanted, and next to nothing is
 * missed or granted: what comes into use was fetched before there was room for it. What cannot be
 * split is counted, in each frame, and next to nothing is split only to be undone. */
START_TEST(flight_in_a_full_pool) {
    enum { FRAMES = 160, BEGUN = 20 };
    flight f;
    mn_session_stats before = {0}, after = {0};
    uint64_t splits = 0, misses = 0, refused = 0, undone = 0, changes = 0, epoch = 0;
    open_with(&f, 16 * PLACES);
    for (int i = 0; i < FRAMES; i++) {
        const mn_camera camera = model_camera(&made, 1.0 * i / FRAMES, 0.8);
        double most_px;
        flight_frame(&f, &camera, 8);
        const mni_work *work = &f.nav.work;
        const uint32_t left = flight_left(&f, &most_px);
        ck_assert_uint_eq(work->refused_front + work->refused_budget, 0);
        ck_assert_uint_le(left, work->refused_pool + work->misses);
        if (i == BEGUN)
            mni_store_stats(f.store, &before);
        if (i > BEGUN) {
            splits += work->splits;
            misses += work->misses;
            refused += work->refused_pool;
            undone += work->undone;
            changes += mni_store_epoch(f.store) != epoch;
        }
        epoch = mni_store_epoch(f.store);
    }
    mni_store_stats(f.store, &after);
    ck_assert_uint_gt(changes, FRAMES / 8);
    ck_assert_uint_gt(refused, splits);
    ck_assert_uint_lt(2 * (after.urgent_down - before.urgent_down), changes);
    ck_assert_uint_lt(misses, changes);
    ck_assert_uint_lt(undone, splits);
    close_it(&f);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("refusals");
    TCase *tc = tcase_create("refusals");
    tcase_set_timeout(tc, 120);
    tcase_add_unchecked_fixture(tc, make, gone);
    tcase_add_test(tc, stands_until_there_is_room);
    tcase_add_test(tc, unknown_until_something_changes);
    tcase_add_test(tc, each_has_its_turn);
    tcase_add_test(tc, what_is_remembered);
    tcase_add_test(tc, refused_at_a_blocker);
    tcase_add_test(tc, lacks_what_is_absent);
    tcase_add_test(tc, put_off_till_the_others_are_through);
    tcase_add_test(tc, enough_is_sought);
    tcase_add_test(tc, a_pass_begins_and_ends);
    tcase_add_test(tc, no_grant_for_what_is_absent);
    tcase_add_test(tc, sought_as_there_are_places);
    tcase_add_test(tc, who_needs_several_is_not_sought);
    tcase_add_test(tc, flight_in_a_full_pool);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
