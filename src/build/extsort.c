/* Sorting more than memory holds: an essay, then the code.
 *
 * What it costs. Aggarwal and Vitter (1988) count what matters: N records lie on disk, M fit in
 * memory, B go in one transfer. Comparing is free, transfers are not, and no sort needs fewer than
 * about
 *
 *     N/B × log(N/B) / log(M/B)
 *
 * of them. Merge sort meets the bound: N/M runs, each sorted in memory, then merged M/B at a time,
 * every pass reading and writing everything once. Its base, M/B, is so large that the logarithm is
 * nearly always 1. With runs of half the memory and buffers of 16 KiB, all moved once by one merge:
 *
 *     memory     runs of    merged at once    one merge is enough for
 *     1 MB       0.5 MB     62                31 MB
 *     4 MB       2 MB       252               500 MB
 *     16 MB      8 MB       1,014             8 GB
 *     64 MB      32 MB      4,060             130 GB
 *
 * (a globe of 18,653,760 triangles has 900 MB of corners, at 16 bytes each). Up to there each byte
 * is written once and read once, and that is what a sort may be charged: 2 × its size. Beyond, it
 * is not all or nothing: R runs where K can be merged need R - K of them gone, and every merge of g
 * runs is rid of g - 1. So only as many as must be are merged beforehand, and 1.1 times too many
 * runs cost about a tenth of a pass more, not a whole one. They are neighbours, because ties must
 * keep their order, and the cheapest neighbours that there are.
 *
 * Why runs are memory loads. Replacement selection, a heap from which the smallest record goes out
 * while the next comes in, makes runs of twice the memory on random input, and tape drives lived by
 * it. But it walks a heap for each record, a missed cache line at each level; sorting a load by
 * radix costs a few sequential passes. Twice as many runs cost nothing while they fit one merge.
 * What replacement selection does for input that is nearly in order is had more cheaply: a load
 * that is in order is not sorted, and one that begins where the last one ended goes on with that
 * run. Input that is sorted already is one run, read back once.
 *
 * Sorting a load. Most significant byte first, from one half of the memory to the other and back:
 * count, and move each record to its bucket. That is stable, it stops as soon as a bucket is small
 * (an insertion sort of two dozen neighbours beats counting 256), and leading bytes that all keys
 * share are skipped at once: half a million random keys are moved twice. Bytes that tell little, as
 * in numbers of vertices or along a space-filling curve, cost a pass each, and there are at
 * most 16. The price is the other half of the memory. Sorting in place would double the runs'
 * length and lose ties' order; sorting pointers saves nothing for records of 8 to 32 bytes, and
 * costs a random access each.
 *
 * Packing. Neighbours in a sorted run are alike, so who knows a record can write what differs from
 * the one before (varint.h): a half to a third of the bytes, at a few nanoseconds a record. What
 * can be computed again, as a key from a position, need not be written at all. A merge unpacks each
 * run's next record into a place of its own.
 *
 * Merging. A loser tree (Knuth, vol. 3, 5.4.1): a tournament whose inner nodes hold the loser of
 * their match, the winner goes on up. When the winner's run brings its next record, it plays only
 * the losers on its own way to the top: log2 K comparisons each, where a heap that is sifted down
 * needs two a level. Keys stand in the leaves, so a match looks at 24 bytes that are in the cache,
 * never at a record.
 *
 *            [winner: 2]                      leaf: key, and which run (ties go to the earlier one;
 *                [1]          a loser              an exhausted run loses against all)
 *              ╱     ╲
 *           [0]       [3]     losers          runs are read in bufferfuls, sequentially each; the
 *          ╱   ╲     ╱   ╲                    next bufferful is on its way while this one is merged
 *        run0 run1 run2 run3                  (src/io/spill.h)
 *
 * One file holds all runs, one behind the other, in order of age; what has been merged is given
 * back to the disk as it is read, so that at most the data, and one merge's worth of them, lie
 * there.
 *
 *   budget ─┬─ this struct, table of runs
 *           └─ work: │ records │ as many again to sort │         while records are put
 *                    │ leaves, losers, readers │ buffer │ … │     while runs are merged
 *
 * The table of runs has a fixed length; when it is full, runs are merged at once, while no records
 * are in memory. So the budget holds for any number of records. Merging needs less than sorting
 * does: who has other use for memory while records are handed out says how much may stay, and the
 * rest goes back to the kernel. One thread. */
#include "extsort.h"

#include <stdbool.h>
#include <string.h>
#include <sys/mman.h>

#include "mn_assert.h"
#include "mem.h"
#include "spill.h"

enum {
    /* Smaller buffers make the disk seek more than it reads, larger ones merge fewer runs: the
     * least, where runs are many. */
    BUFFER_BYTES = 16 << 10,
    BUFFER_BYTES_MAX = 1 << 20,
    WAYS_MIN = 2,
    WAYS_MAX = 4096, /* past that the tree leaves the cache */
    SPARE_RUNS = 16, /* in the table, beyond twice the ways */
    INSERTION_MAX = 24,
    DIGITS_MAX = 16,
    BUCKETS = 256,
    PAGE_BYTES = 4096,
    ALIGN = 16,
};
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "digits are found by their byte");

typedef struct run {
    uint64_t from, bytes; /* in the spill */
} run;

typedef struct key {
    uint64_t high, low;
} key;

typedef struct leaf {
    key key;
    uint32_t order; /* among equal keys; exhausted ones are past all others */
    const void *record;
} leaf;

typedef struct merge {
    uint32_t ways;
    bool started;
    leaf *leaf;
    uint32_t *loser; /* [0]: the winner; [1, ways): inner nodes */
    mni_spill_reader *reader;
    unsigned char *unpacked; /* each way's record, where they are packed */
    unsigned char *buffer;   /* ways + 1 of them; the last is for writing */
    size_t buffer_bytes;
} merge;

typedef enum phase { PUTTING, FROM_MEMORY, MERGING, OVER } phase;

struct mni_sort {
    mni_sort_desc desc;
    phase phase;
    uint32_t digits;              /* bytes of the key */
    uint8_t digit_at[DIGITS_MAX]; /* most significant first: where in the record */
    uint32_t ways_max, runs_max, runs;
    run *run;
    key last;              /* of the newest run */
    unsigned char *newest; /* its record that was packed last */
    unsigned char *work;
    size_t work_bytes, merge_bytes; /* all of it; what merges use, from the front */
    uint64_t room, held, taken;     /* records in memory: that fit, are there, were handed out */
    mni_spill spill;
    merge merge;
    mni_sort_figures figures;
    mni_arena arena; /* in which all this lies */
};

/* ---- the plan -------------------------------------------------------------------------------- */

typedef struct plan {
    uint32_t ways_max, runs_max;
    size_t work_bytes, merge_bytes;
} plan;

/* Of one way of a merge, buffer apart. */
static uint64_t way_bytes(const mni_sort_desc *desc) {
    return sizeof(leaf) + sizeof(mni_spill_reader) + sizeof(uint32_t) +
           (desc->packing != NULL ? desc->record_bytes : 0);
}

/* Of buffers, for so many ways and the writer. */
static uint64_t buffers_bytes(const mni_sort_desc *desc, uint64_t merge_bytes, uint32_t ways) {
    uint64_t own = (ways + 1) * way_bytes(desc) + 3 * ALIGN;
    return merge_bytes > own ? (merge_bytes - own) / (ways + 1) : 0;
}

static plan make_plan(const mni_sort_desc *desc) {
    plan p;
    uint64_t budget = desc->budget_bytes / PAGE_BYTES * PAGE_BYTES,
             after = desc->after_bytes > 0 ? desc->after_bytes / PAGE_BYTES * PAGE_BYTES : budget,
             each = BUFFER_BYTES + way_bytes(desc) + 2 * sizeof(run);
    uint64_t ways = after / each > 1 ? after / each - 1 : 0;
    p.ways_max = ways < WAYS_MIN ? WAYS_MIN : ways > WAYS_MAX ? WAYS_MAX : (uint32_t)ways;
    p.runs_max = 2 * p.ways_max + SPARE_RUNS;
    uint64_t own = sizeof(mni_sort) + p.runs_max * sizeof(run) + desc->record_bytes +
                   4 * ALIGN; /* as open takes it */
    MN_ASSERT(after > own && after <= budget);
    p.work_bytes = (size_t)(budget - own) / ALIGN * ALIGN;
    p.merge_bytes = (size_t)(after - own) / ALIGN * ALIGN;
    return p;
}

uint64_t mni_sort_room(const mni_sort_desc *desc) {
    return make_plan(desc).work_bytes / 2 / desc->record_bytes;
}

mn_code mni_sort_open(mni_sort **out, const mni_sort_desc *desc, mn_status *st) {
    static const uint32_t key_bytes[] = {4, 8, 16};
    MN_ASSERT(desc->record_bytes % 4 == 0 && desc->record_bytes <= MNI_SORT_RECORD_MAX);
    MN_ASSERT(desc->record_bytes >= key_bytes[desc->key]);
    MN_ASSERT(desc->budget_bytes >= MNI_SORT_BUDGET_MIN && desc->temp_dir != NULL);
    MN_ASSERT(desc->after_bytes == 0 || desc->after_bytes >= MNI_SORT_BUDGET_MIN);
    MN_ASSERT(desc->packing == NULL || desc->packing->bytes_max <= MNI_SORT_PACKED_MAX);
    plan p = make_plan(desc);
    mni_arena arena;
    *out = NULL;
    mn_code code = mni_arena_open(&arena, desc->budget_bytes / PAGE_BYTES * PAGE_BYTES, st);
    if (code != MN_OK)
        return code;
    mni_sort *s = mni_arena_take(&arena, 1, sizeof *s, ALIGN);
    s->run = mni_arena_take(&arena, p.runs_max, sizeof *s->run, ALIGN);
    s->work = mni_arena_take(&arena, p.work_bytes, 1, ALIGN);
    s->work_bytes = p.work_bytes;
    s->merge_bytes = p.merge_bytes;
    s->newest = mni_arena_take(&arena, desc->record_bytes, 1, ALIGN);
    mni_arena_seal(&arena);
    s->desc = *desc;
    s->digits = key_bytes[desc->key];
    for (uint32_t i = 0; i < s->digits; i++)
        s->digit_at[i] = (uint8_t)(s->digits <= 8 ? s->digits - 1 - i : i < 8 ? 7 - i : 23 - i);
    s->ways_max = p.ways_max;
    s->runs_max = p.runs_max;
    s->room = mni_sort_room(desc);
    s->spill = (mni_spill){.fd = -1, .dir = desc->temp_dir};
    s->figures.ways_max = p.ways_max;
    s->arena = arena;
    *out = s;
    return MN_OK;
}

void mni_sort_close(mni_sort *sort) {
    if (sort == NULL)
        return;
    mni_spill_close(&sort->spill);
    mni_arena arena = sort->arena; /* it holds the sort */
    mni_arena_close(&arena);
}

mni_sort_figures mni_sort_figures_get(const mni_sort *sort) {
    mni_sort_figures f = sort->figures;
    f.bytes_read = sort->spill.bytes_read;
    f.bytes_written = sort->spill.bytes_written;
    return f;
}

/* ---- keys ------------------------------------------------------------------------------------ */

static inline key key_of(const mni_sort *s, const void *record) {
    key k = {0, 0};
    uint32_t narrow;
    switch (s->desc.key) {
    case MNI_SORT_U32:
        memcpy(&narrow, record, sizeof narrow);
        k.high = narrow;
        break;
    case MNI_SORT_U64:
        memcpy(&k.high, record, sizeof k.high);
        break;
    case MNI_SORT_U128:
        memcpy(&k, record, sizeof k);
        break;
    }
    return k;
}

static inline bool less(key a, key b) {
    return a.high < b.high || (a.high == b.high && a.low < b.low);
}

/* ---- sorting what is in memory ------------------------------------------------------------- */

/* In place; records that are in order already cost a comparison each. */
static void sort_by_insertion(const mni_sort *s, unsigned char *records, uint64_t count) {
    const size_t bytes = s->desc.record_bytes;
    unsigned char moved[MNI_SORT_RECORD_MAX];
    for (uint64_t i = 1; i < count; i++) {
        key mine = key_of(s, records + i * bytes);
        uint64_t to = i;
        while (to > 0 && less(mine, key_of(s, records + (to - 1) * bytes)))
            to--;
        if (to == i)
            continue;
        memcpy(moved, records + i * bytes, bytes);
        memmove(records + (to + 1) * bytes, records + to * bytes, (i - to) * bytes);
        memcpy(records + to * bytes, moved, bytes);
    }
}

/* Each record to its bucket's next place; bytes is a constant in the common sizes. */
static inline __attribute__((always_inline)) void scatter_of(const unsigned char *from,
                                                             unsigned char *to, uint64_t count,
                                                             uint32_t at, uint64_t next[BUCKETS],
                                                             size_t bytes) {
    for (uint64_t i = 0; i < count; i++) {
        const unsigned char *record = from + i * bytes;
        memcpy(to + next[record[at]]++ * bytes, record, bytes);
    }
}

static void scatter(const unsigned char *from, unsigned char *to, uint64_t count, uint32_t at,
                    uint64_t next[BUCKETS], size_t bytes) {
    switch (bytes) {
    case 8:
        scatter_of(from, to, count, at, next, 8);
        break;
    case 12:
        scatter_of(from, to, count, at, next, 12);
        break;
    case 16:
        scatter_of(from, to, count, at, next, 16);
        break;
    case 24:
        scatter_of(from, to, count, at, next, 24);
        break;
    case 32:
        scatter_of(from, to, count, at, next, 32);
        break;
    default:
        scatter_of(from, to, count, at, next, bytes);
        break;
    }
}

/* Sorts records that agree in all digits before `digit`. They are in `from`, and end up in `other`
 * if `away`, else in `from`; the one where they do not is overwritten. As deep as there are digits.
 */
static void sort_by_digits(const mni_sort *s, unsigned char *from, unsigned char *other,
                           uint64_t count, uint32_t digit, bool away) {
    const size_t bytes = s->desc.record_bytes;
    uint64_t start[BUCKETS + 1], next[BUCKETS];
    for (; digit < s->digits && count > INSERTION_MAX; digit++) {
        const unsigned char *at = from + s->digit_at[digit];
        memset(next, 0, sizeof next);
        for (uint64_t i = 0; i < count; i++)
            next[at[i * bytes]]++;
        if (next[at[0]] < count)
            break; /* not all the same */
    }
    if (digit == s->digits || count <= INSERTION_MAX) {
        if (count <= INSERTION_MAX)
            sort_by_insertion(s, from, count);
        if (away)
            memcpy(other, from, count * bytes);
        return;
    }
    start[0] = 0;
    for (uint32_t b = 0; b < BUCKETS; b++) {
        start[b + 1] = start[b] + next[b];
        next[b] = start[b];
    }
    scatter(from, other, count, s->digit_at[digit], next, bytes);
    for (uint32_t b = 0; b < BUCKETS; b++)
        if (start[b + 1] > start[b])
            sort_by_digits(s, other + start[b] * bytes, from + start[b] * bytes,
                           start[b + 1] - start[b], digit + 1, !away);
}

/* The records in memory; whether they were in order already. */
static bool sort_held(mni_sort *s) {
    const size_t bytes = s->desc.record_bytes;
    uint64_t i = 1;
    key before = s->held > 0 ? key_of(s, s->work) : (key){0, 0};
    for (; i < s->held; i++) {
        key now = key_of(s, s->work + i * bytes);
        if (less(now, before))
            break;
        before = now;
    }
    if (i >= s->held)
        return true;
    sort_by_digits(s, s->work, s->work + s->room * bytes, s->held, 0, false);
    return false;
}

/* ---- merging --------------------------------------------------------------------------------- */

static inline bool beats(const leaf *a, const leaf *b) {
    if (a->key.high != b->key.high)
        return a->key.high < b->key.high;
    if (a->key.low != b->key.low)
        return a->key.low < b->key.low;
    return a->order < b->order;
}

/* The way's next record. */
static inline const void *take(const mni_sort *s, merge *m, uint32_t way) {
    const mni_sort_packing *p = s->desc.packing;
    mni_spill_reader *r = &m->reader[way];
    if (p == NULL)
        return mni_spill_take(r, s->desc.record_bytes);
    const unsigned char *at = mni_spill_peek(r, p->bytes_max);
    if (at == NULL)
        return NULL;
    unsigned char *record = m->unpacked + (size_t)way * s->desc.record_bytes;
    mni_spill_skip(r, p->unpack(p->context, at, record));
    return record;
}

static inline void load_leaf(const mni_sort *s, merge *m, uint32_t way) {
    leaf *l = &m->leaf[way];
    l->record = take(s, m, way);
    if (l->record != NULL) {
        l->key = key_of(s, l->record);
    } else {
        l->key = (key){UINT64_MAX, UINT64_MAX};
        l->order = way + m->ways;
    }
}

/* All matches, from the leaves (nodes ways … 2 ways - 1) up. */
static void play_all(merge *m) {
    uint32_t *winner = m->loser; /* of node n, until its parent has been played */
    for (uint32_t n = m->ways; n-- > 1;) {
        uint32_t side[2];
        for (uint32_t i = 0; i < 2; i++)
            side[i] = 2 * n + i < m->ways ? winner[2 * n + i] : 2 * n + i - m->ways;
        winner[n] = beats(&m->leaf[side[0]], &m->leaf[side[1]]) ? side[0] : side[1];
    }
    winner[0] = m->ways > 1 ? winner[1] : 0;
    /* from the top down each node gets its loser: the side whose winner did not go on */
    for (uint32_t n = 1; n < m->ways; n++) {
        uint32_t gone = winner[n], side[2];
        for (uint32_t i = 0; i < 2; i++)
            side[i] = 2 * n + i < m->ways ? winner[2 * n + i] : 2 * n + i - m->ways;
        m->loser[n] = side[0] == gone ? side[1] : side[0];
    }
}

/* The winner's run has a new record: up the way of that leaf. */
static inline void play_again(merge *m) {
    uint32_t going = m->loser[0];
    for (uint32_t n = (going + m->ways) / 2; n > 0; n /= 2) {
        uint32_t waiting = m->loser[n];
        if (beats(&m->leaf[waiting], &m->leaf[going])) {
            m->loser[n] = going;
            going = waiting;
        }
    }
    m->loser[0] = going;
}

/* Neighbouring runs, from `first` on. */
static void merge_open(mni_sort *s, uint32_t first, uint32_t ways) {
    merge *m = &s->merge;
    unsigned char *at = s->work;
    size_t bytes = s->desc.record_bytes, each = buffers_bytes(&s->desc, s->merge_bytes, ways);
    *m = (merge){.ways = ways};
    if (each > BUFFER_BYTES_MAX)
        each = BUFFER_BYTES_MAX;
    m->buffer_bytes = s->desc.packing != NULL ? each : each / bytes * bytes;
    MN_ASSERT(m->buffer_bytes >=
              (s->desc.packing != NULL ? 2 * s->desc.packing->bytes_max : bytes));
    m->leaf = (leaf *)(void *)at;
    at += ways * sizeof *m->leaf;
    m->reader = (mni_spill_reader *)(void *)at;
    at += ways * sizeof *m->reader;
    m->loser = (uint32_t *)(void *)at;
    at += ways * sizeof *m->loser;
    at += (ALIGN - (uintptr_t)at % ALIGN) % ALIGN;
    if (s->desc.packing != NULL) {
        m->unpacked = at;
        memset(at, 0, ways * bytes);
        at += (ways * bytes + ALIGN - 1) / ALIGN * ALIGN;
    }
    m->buffer = at;
    MN_ASSERT(m->buffer + (ways + 1) * m->buffer_bytes <= s->work + s->merge_bytes);
    for (uint32_t i = 0; i < ways; i++) {
        const run *r = &s->run[first + i];
        mni_spill_reader_open(&m->reader[i], &s->spill, r->from, r->from + r->bytes,
                              m->buffer + i * m->buffer_bytes, m->buffer_bytes, true);
        m->leaf[i].order = i;
    }
    for (uint32_t i = 0; i < ways; i++)
        load_leaf(s, m, i);
    play_all(m);
}

static inline const void *merge_next(const mni_sort *s, merge *m) {
    if (m->started) {
        load_leaf(s, m, m->loser[0]);
        play_again(m);
    }
    m->started = true;
    return m->leaf[m->loser[0]].record; /* NULL: the best is exhausted, so all are */
}

/* The newest run's next record. */
static void put_packed(mni_sort *s, mni_spill_writer *w, const void *record) {
    const mni_sort_packing *p = s->desc.packing;
    unsigned char packed[MNI_SORT_PACKED_MAX];
    mni_spill_put(w, packed, (size_t)(p->pack(p->context, packed, record, s->newest) - packed));
    memcpy(s->newest, record, s->desc.record_bytes);
}

/* Makes one run of neighbouring ones, and puts it in their place. */
static void merge_runs(mni_sort *s, uint32_t first, uint32_t ways) {
    mni_spill_writer w;
    const void *record;
    run whole = {.from = s->spill.size_bytes};
    merge_open(s, first, ways);
    memset(s->newest, 0, s->desc.record_bytes);
    mni_spill_writer_open(&w, &s->spill, s->merge.buffer + ways * s->merge.buffer_bytes,
                          s->merge.buffer_bytes);
    while ((record = merge_next(s, &s->merge)) != NULL)
        if (s->desc.packing != NULL)
            put_packed(s, &w, record);
        else
            mni_spill_put(&w, record, s->desc.record_bytes);
    mni_spill_end(&w);
    whole.bytes = s->spill.size_bytes - whole.from;
    s->run[first] = whole;
    memmove(&s->run[first + 1], &s->run[first + ways], (s->runs - first - ways) * sizeof *s->run);
    s->runs -= ways - 1;
    s->last = (key){UINT64_MAX, UINT64_MAX}; /* it may be the newest: none can go on with it */
    s->figures.merges++;
}

/* The neighbours of that number that are the fewest bytes. */
static uint32_t cheapest(const mni_sort *s, uint32_t ways) {
    uint64_t sum = 0, least = UINT64_MAX;
    uint32_t first = 0;
    for (uint32_t i = 0; i < s->runs; i++) {
        sum += s->run[i].bytes;
        if (i >= ways)
            sum -= s->run[i - ways].bytes;
        if (i + 1 >= ways && sum < least) {
            least = sum;
            first = i + 1 - ways;
        }
    }
    return first;
}

/* ---- from the outside ------------------------------------------------------------------------ */

/* What is in memory, sorted, to the end of the file. */
static void write_held(mni_sort *s, bool goes_on) {
    const size_t bytes = s->desc.record_bytes;
    mni_spill_writer w; /* in the half that the sorting has used */
    if (s->desc.packing == NULL) {
        mni_spill_append(&s->spill, s->work, s->held * bytes);
        return;
    }
    if (!goes_on)
        memset(s->newest, 0, bytes);
    mni_spill_writer_open(&w, &s->spill, s->work + s->room * bytes,
                          s->room * bytes < BUFFER_BYTES_MAX ? s->room * bytes : BUFFER_BYTES_MAX);
    for (uint64_t i = 0; i < s->held; i++)
        put_packed(s, &w, s->work + i * bytes);
    mni_spill_end(&w);
}

/* Sorts what is in memory and writes it, as a run of its own or as the end of the newest. */
static void spill_held(mni_sort *s) {
    const size_t bytes = s->desc.record_bytes;
    mn_status *st = &s->spill.trouble;
    if (s->spill.fd < 0 && st->code == MN_OK)
        mni_spill_open(&s->spill, s->desc.temp_dir, st);
    if (st->code == MN_OK) {
        sort_held(s);
        uint64_t from = s->spill.size_bytes;
        bool goes_on = s->runs > 0 && !less(key_of(s, s->work), s->last) &&
                       s->run[s->runs - 1].from + s->run[s->runs - 1].bytes == from;
        s->last = key_of(s, s->work + (s->held - 1) * bytes);
        write_held(s, goes_on);
        if (goes_on) {
            s->run[s->runs - 1].bytes += s->spill.size_bytes - from;
        } else {
            s->run[s->runs++] = (run){from, s->spill.size_bytes - from};
            s->figures.runs++;
        }
    }
    s->held = 0;
    if (s->runs == s->runs_max && st->code == MN_OK)
        merge_runs(s, cheapest(s, s->ways_max), s->ways_max);
}

void mni_sort_put(mni_sort *sort, const void *record) {
    MN_ASSERT(sort->phase == PUTTING);
    const size_t bytes = sort->desc.record_bytes;
    if (sort->held == sort->room)
        spill_held(sort);
    memcpy(sort->work + sort->held++ * bytes, record, bytes);
    sort->figures.records++;
}

/* Pages behind what is used from here on. */
static void give_back(mni_sort *s, size_t used_bytes) {
    uintptr_t from = ((uintptr_t)s->work + used_bytes + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
    uintptr_t to = ((uintptr_t)s->work + s->work_bytes) / PAGE_BYTES * PAGE_BYTES;
    if (s->desc.after_bytes > 0 && to > from)
        (void)madvise((void *)from, to - from, MADV_DONTNEED);
}

mn_code mni_sort_finish(mni_sort *sort, mn_status *st) {
    MN_ASSERT(sort->phase == PUTTING);
    mn_status *own = &sort->spill.trouble;
    const uint64_t held_bytes = sort->held * sort->desc.record_bytes;
    if (sort->spill.fd < 0 && own->code == MN_OK && held_bytes <= sort->merge_bytes) {
        sort_held(sort);
        sort->phase = FROM_MEMORY;
        give_back(sort, held_bytes);
        return MN_OK;
    }
    if (sort->held > 0)
        spill_held(sort);
    give_back(sort, sort->merge_bytes);
    while (sort->runs > sort->ways_max && own->code == MN_OK) {
        uint32_t ways = sort->runs - sort->ways_max + 1;
        ways = ways < sort->ways_max ? ways : sort->ways_max;
        merge_runs(sort, cheapest(sort, ways), ways);
    }
    sort->phase = OVER;
    if (own->code == MN_OK) {
        merge_open(sort, 0, sort->runs);
        sort->phase = MERGING;
    }
    return own->code == MN_OK ? MN_OK : mn_fail(st, own->code, "%s", own->text);
}

const void *mni_sort_next(mni_sort *sort, mn_status *st) {
    const mn_status *own = &sort->spill.trouble;
    const void *record = NULL;
    MN_ASSERT(sort->phase != PUTTING);
    if (sort->phase == MERGING)
        record = merge_next(sort, &sort->merge);
    else if (sort->phase == FROM_MEMORY && sort->taken < sort->held)
        record = sort->work + sort->taken++ * sort->desc.record_bytes;
    /* a run that cannot be read on is as good as at its end: nothing after it is in order */
    if (own->code != MN_OK) {
        mn_fail(st, own->code, "%s", own->text);
        record = NULL;
    }
    if (record == NULL)
        sort->phase = OVER;
    return record;
}
