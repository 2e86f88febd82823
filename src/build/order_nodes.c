/* Step 1 of order.c: collapses, from the last to the first, dealt to their rows.
 *
 * Hides: messages. Where a node's leaves begin, and what switch value it came to, is its parent's
 * to say; the parent was made later, so it is met before. A message to a collapse of the same
 * bucket is written where it belongs, one to an earlier bucket is 8 bytes:
 *
 *     bits 0 … 15 which collapse of the bucket    16 … 46 leaf_lo    47 … 59 switch value
 *
 * Order ids count collapses by stage, then key, then number. Stages are met one after the other, so
 * each is sorted by itself: by falling key, since numbers fall too, equal ones in the order in
 * which they come.
 *
 * A bucket whose collapses know their rows is dealt in a thread of its own, where there is one
 * (relay.h): its rows, what order ids are sorted by, and the simplices that died, which are read
 * then. Memory: plan.nodes_bytes and the sort's. */
#include "mn_assert.h"
#include "extsort.h"
#include "order_parts.h"
#include "relay.h"

typedef struct slot {
    mni_history_collapse is;
    uint32_t low;   /* leaf_lo */
    uint32_t value; /* switch value, as in facts; NOT_TOLD: no message yet */
} slot;
_Static_assert(sizeof(slot) == 48, "as the plan counts them");
enum { NOT_TOLD = UINT16_MAX, TELL_EVERY = 1 << 16 };

typedef struct standing { /* of a collapse in its stage */
    uint32_t falling_key, row;
} standing;

/* Collapses [from, to) of a bucket, all of one stage, whose rows are known; in falling order. */
typedef struct placed {
    const slot *slot;
    uint32_t first, count; /* the bucket */
    uint32_t from, to;     /* of its slots; 0: the last of it, and so its simplices come too */
} placed;

/* The other thread's, while something is with it. */
typedef struct dealer {
    mni_order_work *w;   /* of which it fills rows, simplices, order ids */
    mni_sort *sort;      /* of the stage */
    uint32_t rank;       /* once a stage is over: as below, of the next order id to be dealt */
    mni_history history; /* what it reads of it: a copy, since a spill has one thread */
    uint64_t group_read; /* of the history's, when it was copied */
    unsigned char *buffer;
    mn_status trouble;
} dealer;

typedef struct walk {
    mni_order_work *w;
    mni_buckets message;
    slot *slot, *other; /* the bucket in hand, and where the one before it may be in work still */
    uint32_t first, count; /* collapses in slot */
    void *room;            /* a chunk */
    unsigned char *buffer;
    int stage;            /* 0 … 3: whose collapses are met */
    uint32_t stage_start; /* its first collapse */
    uint32_t rank;        /* of the stage's last collapse, and one: order ids go down from it */
    mni_relay beside;
    placed batch[MNI_RELAY_BATCHES]; /* the relay's, one each */
    dealer dealer;
} walk;

static mn_code spill_trouble(const mni_spill *spill, mn_status *st) {
    return spill->trouble.code == MN_OK
               ? MN_OK
               : mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
}

/* ---- order ids ------------------------------------------------------------------------------ */

/* Along falling keys: the key's difference, and the row's. */
static unsigned char *pack(const void *context, unsigned char *to, const void *record,
                           const void *before) {
    (void)context;
    return mni_words_put(to, record, before, sizeof(standing) / sizeof(uint32_t));
}

static const unsigned char *unpack(const void *context, const unsigned char *from, void *record) {
    (void)context;
    return mni_words_get(from, record, sizeof(standing) / sizeof(uint32_t));
}

static mn_code open_sort(walk *k) {
    static const mni_sort_packing packing = {2 * MNI_VARINT32_MAX, pack, unpack, NULL};
    const mni_sort_desc desc = {.record_bytes = sizeof(standing),
                                .key = MNI_SORT_U32,
                                .budget_bytes = k->w->plan.sort_bytes,
                                .packing = &packing,
                                .temp_dir = k->w->desc->temp_dir};
    return mni_sort_open(&k->dealer.sort, &desc, k->w->st);
}

static void deal_orders(void *context, void *records, uint32_t count) {
    dealer *d = context;
    const standing *s = records;
    const uint32_t bits = d->w->plan.bits;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t order = (uint32_t)d->w->mesh->vertices + --d->rank, bucket = s[i].row >> bits;
        uint16_t at = (uint16_t)(s[i].row & ((1u << bits) - 1));
        unsigned char *to = mni_bucket_put(&d->w->ordered, bucket);
        memcpy(to, &at, sizeof at);
        memcpy(to + sizeof at, &order, sizeof order);
        mni_bucket_put_end(&d->w->ordered, bucket, to + sizeof at + sizeof order);
    }
}

/* The stage has been met to its first collapse, and dealt. */
static mn_code end_stage(walk *k) {
    mni_order_work *w = k->w;
    mni_sort *sort = k->dealer.sort;
    const standing *s;
    mni_relay orders;
    uint32_t left = k->rank;
    mn_code code = mni_sort_finish(sort, w->st);
    k->dealer.rank = k->rank;
    mni_relay_open(&orders, deal_orders, &k->dealer, sizeof *s, k->room, w->plan.chunk_bytes,
                   w->plan.threads);
    while (code == MN_OK && (s = mni_sort_next(sort, w->st)) != NULL) {
        mni_relay_put(&orders, s);
        if (--left % TELL_EVERY == 0)
            code = mni_order_tell(w, w->history->collapses - k->first);
    }
    mni_relay_close(&orders);
    mni_sort_figures figures = mni_sort_figures_get(sort);
    w->out->bytes_read += figures.bytes_read;
    w->out->bytes_written += figures.bytes_written;
    mni_sort_close(sort);
    k->dealer.sort = NULL;
    k->rank = left;
    if (code == MN_OK)
        code = w->st->code; /* of the sort's reading */
    MN_ASSERT(code != MN_OK || k->rank == k->stage_start);
    return code;
}

/* Stages down to that of collapse `number`. */
static mn_code go_to_stage(walk *k, uint32_t number) {
    mn_code code = k->dealer.sort != NULL ? end_stage(k) : MN_OK;
    while (number < k->stage_start) {
        MN_ASSERT(k->stage > 0);
        k->stage--;
        k->rank = k->stage_start;
        k->stage_start -= (uint32_t)k->w->history->counts.collapses_by_stage[k->stage];
    }
    return code == MN_OK ? open_sort(k) : code;
}

/* ---- what a collapse sends ------------------------------------------------------------------ */

static void tell_child(walk *k, uint32_t node, uint32_t low, uint32_t value) {
    uint32_t number = node - MNI_COLLAPSE, bits = k->w->plan.bits;
    if (node < MNI_COLLAPSE)
        return;
    if (number >= k->first) {
        k->slot[number - k->first].low = low;
        k->slot[number - k->first].value = value;
        return;
    }
    uint64_t message = (number & ((1u << bits) - 1)) | (uint64_t)low << 16 | (uint64_t)value << 47;
    unsigned char *to = mni_bucket_put(&k->message, number >> bits);
    memcpy(to, &message, sizeof message);
    mni_bucket_put_end(&k->message, number >> bits, to + sizeof message);
}

static unsigned char *put_at(mni_order_work *w, mni_buckets *dealt, uint32_t row) {
    unsigned char *to = mni_bucket_put(dealt, row >> w->plan.bits);
    uint16_t at = (uint16_t)(row & ((1u << w->plan.bits) - 1));
    memcpy(to, &at, sizeof at);
    return to + sizeof at;
}

static unsigned char *put_child(unsigned char *to, uint32_t leaves, uint32_t id, uint32_t split,
                                uint32_t *last) {
    to = mni_varint_put(to, leaves);
    return leaves == 1 ? mni_order_put_id(to, id, last) : mni_varint_put(to, split);
}

static void put_row(mni_order_work *w, const slot *s, uint32_t row) {
    const mni_history_collapse *c = &s->is;
    unsigned char *to = put_at(w, &w->row, row);
    uint32_t *last = mni_bucket_last(&w->row, row >> w->plan.bits);
    to = put_child(to, c->left_leaves, c->left, c->left_split, last);
    to = put_child(to, c->right_leaves, c->right, c->right_split, last);
    uint64_t facts = s->value | mni_facts_bounds(c->facts) << MNI_FACTS_VALUE_BITS;
    memcpy(to, &facts, sizeof facts); /* the last byte is 0, and written over */
    to = mni_varint_put(to + MNI_ORDER_FACTS_BYTES, c->simplices);
    mni_bucket_put_end(&w->row, row >> w->plan.bits, to);
    if (c->left_leaves == 1 && (row & ((1u << w->plan.bits) - 1)) == 0) {
        /* the leaf before stands in the bucket before */
        to = put_at(w, &w->row, row - 1);
        *to++ = 0;
        to = mni_order_put_id(to, c->left, mni_bucket_last(&w->row, (row - 1) >> w->plan.bits));
        mni_bucket_put_end(&w->row, (row - 1) >> w->plan.bits, to);
    }
}

static void tell_children(walk *k, uint32_t i) {
    const slot *s = &k->slot[i];
    const mni_history_collapse *c = &s->is;
    MN_ASSERT(s->value != NOT_TOLD);
    MN_ASSERT(s->low + c->left_leaves + c->right_leaves <= k->w->mesh->vertices);
    tell_child(k, c->left, s->low, mni_facts_left_value(c->facts));
    tell_child(k, c->right, s->low + c->left_leaves, mni_facts_right_value(c->facts));
}

static void put_simplex(mni_order_work *w, uint32_t row, uint32_t which, const uint32_t id[3]) {
    unsigned char *to = put_at(w, &w->simplex, row);
    to = mni_varint_put(to, which);
    to = mni_order_put_id(to, id[0], mni_bucket_last(&w->simplex, row >> w->plan.bits));
    to = mni_varint_put(to, mni_fold(id[1], id[0]));
    to = mni_varint_put(to, id[2] == MN_NONE ? 0 : mni_fold(id[2], id[0]));
    mni_bucket_put_end(&w->simplex, row >> w->plan.bits, to);
}

/* ---- buckets -------------------------------------------------------------------------------- */

static mn_code load_bucket(walk *k) {
    mni_spill *spill = &k->w->history->collapse;
    mni_history_reader r;
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < k->count && code == MN_OK; i++) {
        if (i % MNI_HISTORY_GROUP == 0)
            code = mni_history_group(&r, k->w->history, (k->first + i) / MNI_HISTORY_GROUP,
                                     k->buffer, MNI_ORDER_BUFFER_BYTES, k->w->st);
        if (code == MN_OK && !mni_history_next(&r, &k->slot[i].is))
            code = spill_trouble(spill, k->w->st);
        k->slot[i].value = NOT_TOLD;
    }
    return code;
}

static mn_code take_messages(walk *k) {
    mni_bucket_reader r;
    mni_bucket_read(&r, &k->message, k->first >> k->w->plan.bits, k->room);
    do {
        for (; r.at < r.end; r.at += sizeof(uint64_t)) {
            uint64_t message;
            memcpy(&message, r.at, sizeof message);
            slot *s = &k->slot[message & 0xffff];
            s->low = message >> 16 & 0x7fffffff;
            s->value = (uint32_t)(message >> 47);
        }
    } while (mni_bucket_more(&r, &k->message));
    return spill_trouble(&k->message.spill, k->w->st);
}

static void deal_killed(dealer *d, const placed *p) {
    mni_history_reader r;
    mn_code code = d->trouble.code;
    for (uint32_t i = 0; i < p->count && code == MN_OK; i++) {
        const slot *s = &p->slot[i];
        uint32_t id[3];
        if (i % MNI_HISTORY_GROUP == 0)
            code = mni_history_group_killed(&r, &d->history, (p->first + i) / MNI_HISTORY_GROUP,
                                            d->buffer, MNI_ORDER_BUFFER_BYTES, &d->trouble);
        for (uint32_t n = 0; n < s->is.simplices && code == MN_OK; n++)
            if (mni_history_next_killed(&r, id))
                put_simplex(d->w, s->low + s->is.left_leaves, n, id);
            else
                code = spill_trouble(&d->history.killed, &d->trouble);
    }
}

static void deal_placed(void *context, void *records, uint32_t count) {
    dealer *d = context;
    const placed *p = records;
    for (; count > 0; count--, p++) {
        for (uint32_t i = p->to; i-- > p->from;) {
            const uint32_t row = p->slot[i].low + p->slot[i].is.left_leaves;
            const standing at = {~p->slot[i].is.key, row};
            put_row(d->w, &p->slot[i], row);
            mni_sort_put(d->sort, &at);
        }
        if (p->from == 0)
            deal_killed(d, p);
    }
}

/* Until nothing is with the other thread. */
static mn_code wait_for_dealer(walk *k) {
    mni_relay_drain(&k->beside);
    const mn_status *trouble = &k->dealer.trouble;
    if (trouble->code != MN_OK)
        return mn_fail(k->w->st, trouble->code, "%s", trouble->text);
    const mn_code code = spill_trouble(&k->w->row.spill, k->w->st);
    return code == MN_OK ? spill_trouble(&k->w->simplex.spill, k->w->st) : code;
}

/* The bucket, stage by stage; of the last one nothing is waited for. */
static mn_code give_placed(walk *k) {
    slot *const given = k->slot;
    uint32_t to = k->count;
    mn_code code = MN_OK;
    while (to > 0 && code == MN_OK) {
        code = wait_for_dealer(k);
        if (code == MN_OK && k->first + to <= k->stage_start)
            code = go_to_stage(k, k->first + to - 1);
        if (code != MN_OK)
            break;
        const uint32_t from = k->first < k->stage_start ? k->stage_start - k->first : 0;
        mni_relay_put(&k->beside, &(placed){given, k->first, k->count, from, to});
        to = from;
    }
    k->slot = k->other;
    k->other = given;
    return code;
}

static void open_dealer(walk *k) {
    k->dealer.w = k->w;
    k->dealer.history = *k->w->history;
    k->dealer.group_read = k->dealer.history.group.bytes_read;
    mni_relay_open(&k->beside, deal_placed, &k->dealer, sizeof(placed), k->batch, sizeof k->batch,
                   k->w->plan.threads);
}

/* code: of the walk. One that has failed is told as it did, whatever befell the other thread. */
static mn_code close_dealer(walk *k, mn_code code) {
    mni_history *h = k->w->history;
    if (code == MN_OK)
        code = wait_for_dealer(k);
    mni_relay_close(&k->beside); /* drains */
    h->killed.bytes_read = k->dealer.history.killed.bytes_read;
    h->group.bytes_read += k->dealer.history.group.bytes_read - k->dealer.group_read;
    return code;
}

static mn_code walk_bucket(walk *k, uint32_t bucket) {
    mni_order_work *w = k->w;
    uint32_t size = 1u << w->plan.bits, total = w->history->collapses;
    k->first = bucket * size;
    k->count = total - k->first < size ? total - k->first : size;
    mn_code code = load_bucket(k);
    if (code == MN_OK)
        code = take_messages(k);
    if (code == MN_OK && k->first + k->count == total) { /* the root has no parent */
        k->slot[k->count - 1].low = 0;
        k->slot[k->count - 1].value = mni_facts_value(w->history->root_value);
    }
    for (uint32_t i = k->count; i-- > 0 && code == MN_OK;)
        tell_children(k, i);
    if (code == MN_OK)
        code = give_placed(k);
    return code == MN_OK ? mni_order_tell(w, total - k->first) : code;
}

mn_code mni_order_nodes(mni_order_work *w) {
    const mni_order_plan *p = &w->plan;
    mni_arena arena;
    walk k = {.w = w, .stage = 4, .stage_start = w->history->collapses};
    mn_code code = mni_arena_open(&arena, p->nodes_bytes, w->st);
    if (code != MN_OK)
        return code;
    mni_buckets_open(&k.message, p->buckets, p->chunk_bytes, &arena, w->desc->temp_dir);
    k.slot = mni_arena_take(&arena, (size_t)1 << p->bits, sizeof *k.slot, 8);
    k.other =
        p->threads > 1 ? mni_arena_take(&arena, (size_t)1 << p->bits, sizeof *k.other, 8) : k.slot;
    k.room = mni_arena_take(&arena, p->chunk_bytes, 1, 8);
    k.buffer = mni_arena_take(&arena, MNI_ORDER_BUFFER_BYTES, 1, 8);
    k.dealer.buffer = mni_arena_take(&arena, MNI_ORDER_BUFFER_BYTES, 1, 8);
    open_dealer(&k);
    for (uint32_t b = (w->history->collapses - 1) >> p->bits; code == MN_OK; b--) {
        code = walk_bucket(&k, b);
        if (b == 0)
            break;
    }
    code = close_dealer(&k, code);
    if (code == MN_OK)
        code = end_stage(&k);
    mni_sort_close(k.dealer.sort);
    w->out->bytes_read += k.message.spill.bytes_read;
    w->out->bytes_written += k.message.spill.bytes_written;
    mni_buckets_close(&k.message);
    mni_arena_close(&arena);
    if (code == MN_OK)
        code = spill_trouble(&w->ordered.spill, w->st);
    return code;
}
