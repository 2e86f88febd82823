/* See rounds.h. Hidden here: what goes from round to round, and who may take the next cell.
 *
 * The first round's cells are dealt (deal.h), the others' are tiles (tiles.h), so each round has
 * two sets of them: what it takes, and what it leaves.
 *
 *   deal ──► cells ──► tiles ──► cells ──► tiles ──► …
 *      └─ samples ──────┘ └─ samples ───────┘
 *
 * A record that is left lies in the tile of its vertex on the next curve; a simplex in the lowest
 * of its corners' tiles. A vertex is at the border when a neighbour's tile is not one of its
 * cell's; so it says how far its neighbours' tiles reach. A simplex between cells passes through
 * one of them, to the next round, and the corners that lie in others get sights of it.
 *
 * Threads. Cells are begun in turn and numbered in turn, under the lock; a thread then works on
 * its cell alone. Parcels come in any order, and are taken by the cells' numbers. */
#include "rounds.h"

#include <malloc.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "aside.h"
#include "curve.h"
#include "deal.h"
#include "give.h"
#include "mem.h"
#include "tiles.h"
#include "wait.h"

/* How strict a round is: 0: rings wait; from IN_ORDER on they do not, and levels begin (wait.h),
 * the first of which is in order too. Where costs rise evenly over a whole region, all of it is put
 * off, from the cells' edges inwards: after a round with fewer collapses than a SLOW_PART of its
 * vertices, rings are not waited for, until a round makes a FAIR_PART again. */
enum { RINGS = 0, IN_ORDER = 1, LOOSEST = IN_ORDER + MNI_LEVELS - 1 };
enum { SLOW_PART = 8, FAIR_PART = 4 };
/* Rounds that stay in order although they are slow may take as many vertices as the mesh has, and
 * so many cells', all of them together: so bytes that are moved have a bound. After these, or when
 * so many in a row have made fewer than a STUCK_PART, a slow round is followed by one on the least
 * level that will do, as far as can be told from what waited: a SLOW_PART of the vertices would go,
 * or half of those that would on any. If so few go that it did not do, it is one level more. Two
 * rounds in vain, which make so few though they are on the last level, or though hardly any waits
 * for the order: the stage is as good as done, and the next one allows more. In the last one
 * nothing but cells that grow helps (every vertex joined to places all over the model). */
enum { SLOW_CELLS = 64, STUCK_PART = 64, VAIN_ROUNDS = 2, STUCK_ROUNDS_IN_ORDER = 12 };

/* A round in whose cells fewer than an INSIDE_PART of the vertices have their rings: the model
 * cannot be cut, whatever the order. After two of them cells grow, up to so many times what is
 * usual; then, and where rounds are stuck for good, all simplices are set aside (aside.h). */
enum { INSIDE_PART = 256, APART_ROUNDS = 2, GROWN_MAX = 8 };

/* Of what is left beside the usual cells, this share is for those that are not; where that is
 * little, more, up to half a cell: the Earth's poles, of 4,320 triangles each, take a third more
 * than is usual, and 16 MB must do for them. */
static const double SPARE_SHARE = 0.125, SPARE_SHARE_MAX = 0.4;

enum { THREADS_MAX = 16 };

/* More triangles, in parts of what a cell has of vertices, and a vertex is in no cell: with one the
 * largest cell is half as large again as is usual, and the Earth's poles have fewer. So many hubs,
 * in parts of it too: each is in every cell. */
static const double HUB_FAN = 0.625, HUBS_MAX = 0.5;
/* Where cells have hardly a fan, hubs would be all there is. */
enum { HUB_CELLS_MIN = 64 };

/* A cell that is dealt more triangles, in parts of its vertices, is cut. */
enum { DENSE_PART = 6 };
/* Tiles in a cell; samples in a tile of which cells leave as much as they do of surfaces. */
enum { CELL_TILES = 8, TILE_SAMPLES = 64 };
/* What a round leaves of its vertices, of 100: 40 in the first, 46 in late ones. */
enum { LEFT_PERCENT = 43 };
/* A vertex with its simplices, in parcels. */
enum { PARCEL_BYTES = 176 };
enum { CELL_VERTICES_MIN = 1024 }; /* unless it is asked for */
enum { TILES_BYTES_MIN = 64 << 10, REST_BYTES_MIN = 2 << 20, REST_BYTES_LEAST = 5 << 18 };
/* Another thread's stack, and what the heap keeps for it. A tile's share of the tables: of what is
 * left, and of what is taken, which is half as much; so far the least memory has room for them. */
enum { THREAD_BYTES = 512 << 10, TILE_BYTES = 80, TABLES_MAX = REST_BYTES_MIN - REST_BYTES_LEAST };
#define DEAL_BYTES (UINT64_C(64) << 20) /* more is not used */

/* Of the memory beside cells, what each may have. */
static const double deal_share = 0.45, samples_share = 0.05, tiles_share = 0.4;

typedef struct rounds {
    /* const while a round goes on */
    mni_extmesh *mesh;
    mni_rounds_desc desc;
    mni_curve curve, sample_curve; /* the next round's, and that of the one after it */
    float low[3], high[3], step;
    uint32_t round;
    bool whole;                      /* the last one */
    uint64_t rest_bytes;             /* memory beside cells; 0: no bound */
    uint64_t cells_bytes;            /* for cells, all threads together */
    uint64_t usual_cells, all_bytes; /* of cells as they are planned; for both */
    int stage;
    uint32_t order, carrying_order; /* RINGS … LOOSEST; of rounds that carry hubs */
    uint32_t stuck, vain;           /* rounds */
    uint64_t slow_vertices;         /* of slow rounds in order */
    uint32_t apart;                 /* rounds whose cells have hardly a ring */
    bool lone;                      /* one cell has all, but for what is aside */
    uint32_t cell_vertices, sample_every;
    uint32_t cells_most, threads_most; /* with another cap; as asked for */
    uint32_t vertices, cells;          /* of this round */
    uint64_t simplices;
    bool carries;            /* hubs go from cell to cell */
    mni_frozen_table frozen; /* as cells are to see them; carried ones change in between */
    mni_tiles *now, *next;   /* these have locks of their own */
    /* guarded by lock */
    pthread_mutex_t lock;
    pthread_cond_t turn;
    mni_deal *deal;           /* the first round's */
    mni_sort *samples;        /* of what is left */
    uint32_t taken, numbered; /* cells */
    bool taking;
    uint64_t used_bytes;           /* by the cells that are open */
    mni_frozen_table told;         /* what hubs have come to */
    uint32_t inside;               /* vertices with all of their ring in their cell */
    uint32_t could_go[MNI_LEVELS]; /* of these, by the least level */
    mni_aside aside;
    mni_history *history;
    mn_code code;
    mn_status *st;
    mni_tiles tiles[2];
} rounds;

/* ---- filling a cell ------------------------------------------------------------------------- */

/* What there is for a cell, and the cell. */
typedef struct job {
    uint32_t number; /* of the cell */
    mni_hand hand;
    mni_crate crate;
    uint64_t bytes; /* at its peak */
    mni_cell cell;
    mni_shelf shelf; /* of its thread: at most as much as the cell may take */
} job;

/* Of a cell of so many vertices of a surface, with what comes from beside it. */
static uint64_t usual_bytes(uint64_t vertices) {
    vertices += vertices / 16;
    return mni_cell_bytes(vertices, 9 * vertices / 4, PARCEL_BYTES * vertices);
}

/* What cells get of so much memory; rises with it, and with the threads. */
static uint64_t cells_share(const rounds *r, uint64_t work_bytes) {
    uint64_t one = usual_bytes(r->desc.cell_vertices), usual = one * r->desc.threads;
    uint64_t most = work_bytes - REST_BYTES_LEAST;
    double rest = work_bytes > usual ? (double)(work_bytes - usual) : 0;
    double some = fmin(SPARE_SHARE_MAX * rest, (double)one / 2);
    uint64_t share = usual + (uint64_t)fmax(some, SPARE_SHARE * rest);
    return share < most ? share : most;
}

/* What is enough to the end where a cell does not fit. Cells that are larger than grown ones are
 * not taken as they are (go_on), but for those that are dealt; and what has been set aside takes
 * its least bytes in the end. */
static uint64_t enough_for(const rounds *r, uint64_t bytes, bool ordinary) {
    const uint64_t aside = mni_aside_least((uint64_t)r->vertices + r->frozen.count);
    uint64_t most = ordinary ? 3 * usual_bytes(r->cells_most) / 2
                             : usual_bytes((uint64_t)GROWN_MAX * r->cells_most);
    most = bytes > most ? bytes : most;
    most += REST_BYTES_MIN + TABLES_MAX + r->threads_most * THREAD_BYTES;
    return most > aside || ordinary ? most : aside;
}

/* Whether such a cell is one of a surface, hardly larger than usual, as at a pole: that its cells
 * do not grow is what is to be expected, not proven. */
static bool is_ordinary(const rounds *r, uint64_t bytes) {
    return r->frozen.count == 0 && r->simplices * 2 <= (uint64_t)r->vertices * 5 &&
           2 * bytes <= 3 * usual_bytes(r->desc.cell_vertices);
}

/* Under the lock: whether such a cell fits at all. */
static mn_code check_room(const rounds *r, uint64_t bytes) {
    if (bytes <= r->cells_bytes)
        return MN_OK;
    return mn_fail(r->st, MN_CAP_TOO_SMALL,
                   "a part of the model that cannot be cut takes %llu MB; try %s %lluM",
                   (unsigned long long)(bytes >> 20), mni_cap_option(&r->desc.cap),
                   mni_cap_megabytes(&r->desc.cap, enough_for(r, bytes, is_ordinary(r, bytes))));
}

/* Under the lock: the first round's are dealt in turn; what others have is known. */
static mn_code begin_cell(rounds *r, job *j) {
    uint64_t hubs = r->frozen.count;
    if (r->round > 0) {
        j->crate = mni_tiles_cell(r->now, j->number);
        j->bytes = mni_cell_bytes(j->crate.vertices + hubs, j->crate.simplices, j->crate.bytes);
        return MN_OK;
    }
    mn_code code = mni_deal_next(r->deal, &j->hand, r->st);
    j->bytes = mni_cell_dealt_bytes(j->hand.vertices + j->hand.ghosts + hubs, j->hand.triangles);
    return code;
}

/* Under the lock: whether the cell has to wait: for room beside those that are open, which do not
 * wait for it; for hubs, until the one before has told what they have come to. */
static bool waits(const rounds *r, const job *j) {
    return (r->used_bytes + j->bytes > r->cells_bytes && r->used_bytes > 0) ||
           (r->carries && r->numbered < j->number && r->code == MN_OK);
}

/* Under the lock. Who waits keeps no memory from those that work. */
static void wait_for_turn(rounds *r, job *j) {
    mni_shelf_trim(&j->shelf, 0);
    pthread_cond_wait(&r->turn, &r->lock);
}

/* Under the lock; one thread at a time. */
static mn_code take_cell(rounds *r, job *j) {
    while (r->taking)
        wait_for_turn(r, j);
    j->bytes = 0;
    j->number = r->taken;
    if (r->taken == r->cells || r->code != MN_OK)
        return r->code;
    r->taking = true;
    r->taken++;
    mn_code code = begin_cell(r, j);
    if (code == MN_OK)
        code = check_room(r, j->bytes);
    while (code == MN_OK && waits(r, j))
        wait_for_turn(r, j);
    mni_shelf_trim(&j->shelf, j->bytes);
    r->used_bytes += j->bytes;
    r->taking = false;
    pthread_cond_broadcast(&r->turn);
    return code;
}

static void free_job(job *j) {
    mni_cell_close(&j->cell);
    mni_hand_free(&j->hand);
    mni_crate_free(&j->crate);
    mni_shelf_close(&j->shelf);
    *j = (job){0};
}

/* ---- samples -------------------------------------------------------------------------------- */

static void put_sample(mni_sort *to, const mni_curve *curve, const float p[3], uint32_t id) {
    mni_tile_sample sample = {.id = id, .key = mni_curve_key(curve, p)};
    mni_sort_put(to, &sample);
}

/* Under the lock: some of what is left, on the curve after the next one. */
static void sample_cell(rounds *r, const mni_cell *cell) {
    for (uint32_t v = 0; v < cell->own; v++)
        if (cell->s.surface.vertex[v].node != MN_NONE && cell->node[v].id % r->sample_every == 0)
            put_sample(r->samples, &r->sample_curve, cell->s.surface.vertex[v].p, cell->node[v].id);
}

/* ---- threads -------------------------------------------------------------------------------- */

/* Under the lock. */
static void fail(rounds *r, const mn_status *st) {
    if (r->code == MN_OK) {
        r->code = st->code;
        *r->st = *st;
    }
    pthread_cond_broadcast(&r->turn);
}

static uint32_t made_so_far(const rounds *r) {
    return r->history->collapses + r->aside.late_count;
}

static mn_code tell(const rounds *r, mn_status *st) {
    if (r->desc.progress == NULL ||
        r->desc.progress(r->desc.progress_context, "simplify", made_so_far(r), r->mesh->vertices))
        return MN_OK;
    return mn_fail(st, MN_FAILED, "interrupted");
}

static void keep_root(rounds *r, const mni_cell *cell) {
    mni_wire_vertex root;
    uint32_t v = 0;
    while (!mni_cell_vertex(cell, v, &root))
        v++;
    r->history->root_value = root.value;
    r->history->root_levels = root.levels;
}

/* Under the lock: what a cell has made gets its numbers, cell by cell, and goes. */
static mn_code number_cell(rounds *r, uint32_t c, mni_cell *cell, mn_status *st) {
    while (r->numbered != c && r->code == MN_OK)
        pthread_cond_wait(&r->turn, &r->lock);
    if (r->code != MN_OK)
        return r->code;
    mni_cell_number(cell, made_so_far(r));
    mn_code code = mni_cell_set_aside(cell, st);
    if (code == MN_OK && cell->aside_count > 0)
        code = mni_aside_add(&r->aside, cell, st);
    if (code == MN_OK && r->aside.all) {
        code = mni_aside_late(&r->aside, cell, st);
        mni_history_count(r->history, cell);
    } else if (code == MN_OK) {
        code = mni_history_add(r->history, cell, st);
    }
    mni_cell_forget(cell);
    r->inside += cell->inside;
    for (int level = 0; level < MNI_LEVELS; level++)
        r->could_go[level] += cell->could_go[level];
    mni_cell_tell_hubs(cell, &r->told);
    if (r->carries)
        mni_frozen_copy(&r->frozen, &r->told);
    if (code == MN_OK && r->whole)
        keep_root(r, cell);
    if (code == MN_OK && !r->whole)
        sample_cell(r, cell);
    r->numbered++;
    pthread_cond_broadcast(&r->turn);
    return code == MN_OK ? tell(r, st) : code;
}

/* From inside a cell. */
static bool go_on_with(void *context) {
    rounds *r = context;
    mn_status interrupted = {0};
    pthread_mutex_lock(&r->lock);
    bool goes_on = r->code == MN_OK && tell(r, &interrupted) == MN_OK;
    pthread_mutex_unlock(&r->lock);
    return goes_on;
}

static mn_code open_dealt(job *j, const mni_cell_desc *desc, mn_status *st) {
    mn_code code = mni_cell_open_dealt(&j->cell, desc, &j->hand, st);
    mni_hand_free(&j->hand);
    return code;
}

static uint32_t order_of(const rounds *r) {
    return r->carries ? r->carrying_order : r->order;
}

static int level_of(uint32_t order) {
    return order == RINGS ? 0 : (int)order - IN_ORDER;
}

/* What there is becomes a cell. */
static mn_code open_cell(rounds *r, job *j, mn_status *st) {
    mni_cell_desc desc = {.metric = r->desc.metric,
                          .whole = r->whole,
                          .stage = r->stage,
                          .slack = ldexp(1, mni_wait_log2(level_of(order_of(r)))),
                          .rings = order_of(r) == RINGS,
                          .frozen = r->stage < 4 || r->whole ? &r->frozen : NULL,
                          .carries = r->carries,
                          .points = r->aside.all,
                          .poll = {go_on_with, r}};
    if (r->round == 0)
        return open_dealt(j, &desc, st);
    mn_code code = mni_tiles_take(r->now, &j->crate, st);
    if (code == MN_OK)
        code = mni_cell_open_taken(&j->cell, &desc, &j->crate, r->step, st);
    mni_crate_free(&j->crate);
    return code;
}

/* Under the lock, which it leaves while it works. */
static mn_code do_cell(rounds *r, job *j, mn_status *st) {
    mn_code code = take_cell(r, j);
    if (code != MN_OK)
        *st = *r->st;
    if (code != MN_OK || j->number == r->cells) {
        r->used_bytes -= j->bytes;
        return code;
    }
    mni_outlet outlet = {&r->curve, r->next, r->step, j->number};
    pthread_mutex_unlock(&r->lock);
    code = open_cell(r, j, st);
    if (code == MN_OK)
        code = mni_cell_run(&j->cell, st);
    pthread_mutex_lock(&r->lock);
    if (code == MN_OK)
        code = number_cell(r, j->number, &j->cell, st);
    pthread_mutex_unlock(&r->lock);
    if (code == MN_OK && !r->whole)
        code = mni_give(&outlet, &j->cell, st);
    mni_cell_close(&j->cell);
    pthread_mutex_lock(&r->lock);
    r->used_bytes -= j->bytes;
    pthread_cond_broadcast(&r->turn);
    return code;
}

/* Cells that have grown fit it too. */
static uint64_t shelf_bytes(const rounds *r) {
    const uint64_t grown = usual_bytes((uint64_t)GROWN_MAX * r->desc.cell_vertices);
    return r->cells_bytes < grown ? r->cells_bytes : grown;
}

static void *worker(void *context) {
    rounds *r = context;
    job j = {0};
    mn_status st = {0};
    mni_shelf_open(&j.shelf, (size_t)shelf_bytes(r));
    pthread_mutex_lock(&r->lock);
    while (r->taken < r->cells && r->code == MN_OK)
        if (do_cell(r, &j, &st) != MN_OK)
            fail(r, &st);
    pthread_mutex_unlock(&r->lock);
    free_job(&j);
    return NULL;
}

/* ---- rounds --------------------------------------------------------------------------------- */

static mn_code run_round(rounds *r) {
    pthread_t thread[THREADS_MAX];
    uint32_t started = 0;
    r->taken = r->numbered = r->inside = 0;
    memset(r->could_go, 0, sizeof r->could_go);
    while (started + 1 < r->desc.threads && pthread_create(&thread[started], NULL, worker, r) == 0)
        started++;
    worker(r);
    while (started > 0)
        pthread_join(thread[--started], NULL);
    return r->code;
}

static void close_tiles(rounds *r, mni_tiles *t) {
    r->history->bytes_read += t->spill.bytes_read;
    r->history->bytes_written += t->spill.bytes_written;
    mni_tiles_close(t);
}

static void close_samples(rounds *r) {
    if (r->samples == NULL)
        return;
    mni_sort_figures f = mni_sort_figures_get(r->samples);
    r->history->bytes_read += f.bytes_read;
    r->history->bytes_written += f.bytes_written;
    mni_sort_close(r->samples);
    r->samples = NULL;
}

static void close_deal(rounds *r) {
    if (r->deal == NULL)
        return;
    uint64_t read, written;
    mni_deal_bytes(r->deal, &read, &written);
    r->history->bytes_read += read;
    r->history->bytes_written += written;
    mni_deal_close(r->deal);
    r->deal = NULL;
}

/* A share of the memory beside cells; of no more than all of it takes, where that is known. */
static uint64_t share_of(const rounds *r, double share, uint64_t all, uint64_t least) {
    uint64_t some = r->rest_bytes == 0 ? all : (uint64_t)(share * (double)r->rest_bytes);
    some = some < all ? some : all;
    return some > least ? some : least;
}

static mn_code open_samples(rounds *r) {
    uint64_t all = 2 * (r->vertices / r->sample_every + 64) * sizeof(mni_tile_sample) +
                   2 * MNI_SORT_BUDGET_MIN;
    mni_sort_desc desc = {.record_bytes = sizeof(mni_tile_sample),
                          .key = MNI_SORT_U128,
                          .budget_bytes = share_of(r, samples_share, all, MNI_SORT_BUDGET_MIN),
                          .temp_dir = r->desc.temp_dir};
    return mni_sort_open(&r->samples, &desc, r->st);
}

/* Before cells of so many bytes: where the largest is not usual, buffers make room for it. */
static mn_code make_room(rounds *r, uint64_t largest) {
    if (r->desc.work_bytes == 0)
        return MN_OK;
    uint64_t most = r->all_bytes > REST_BYTES_MIN ? r->all_bytes - REST_BYTES_MIN : 0;
    most = largest < most ? largest : most;
    r->cells_bytes = r->usual_cells > most ? r->usual_cells : most;
    r->rest_bytes = r->all_bytes - r->cells_bytes;
    return largest > r->usual_cells ? mni_tiles_empty(r->now, r->st) : MN_OK;
}

static uint64_t largest_cell(const rounds *r) {
    uint64_t largest = 0;
    for (uint32_t c = 0; c < r->cells; c++) {
        mni_crate crate = mni_tiles_cell(r->now, c);
        uint64_t bytes = mni_cell_bytes((uint64_t)crate.vertices + r->frozen.count, crate.simplices,
                                        crate.bytes);
        largest = bytes > largest ? bytes : largest;
    }
    return largest;
}

/* Of vertices that are dealt: those that are left are sampled by their cells. */
static mn_code sample_deal(rounds *r) {
    const mni_ghost *s;
    mn_code code = open_samples(r);
    while (code == MN_OK && (s = mni_deal_sample(r->deal, r->st)) != NULL)
        put_sample(r->samples, &r->curve, s->position, s->id);
    return code == MN_OK ? r->st->code : code;
}

/* Before a round: where what it leaves is to go, by the samples of what there is. */
static mn_code open_next(rounds *r) {
    uint64_t left = (uint64_t)r->vertices * LEFT_PERCENT / 100;
    uint64_t tiles = left * CELL_TILES / r->cell_vertices + 1;
    uint64_t bytes =
        share_of(r, tiles_share, PARCEL_BYTES * left + TILES_BYTES_MIN, TILES_BYTES_MIN);
    r->curve = mni_curve_make(r->low, r->high, r->round + 1);
    r->sample_curve = mni_curve_make(r->low, r->high, r->round + 2);
    mn_code code = r->round == 0 ? sample_deal(r) : MN_OK;
    if (code == MN_OK)
        code = mni_sort_finish(r->samples, r->st);
    if (code == MN_OK)
        code = mni_tiles_open(r->next, (uint32_t)tiles, r->samples, (size_t)bytes, r->desc.temp_dir,
                              r->st);
    close_samples(r);
    return code == MN_OK ? open_samples(r) : code;
}

/* What was left is what is taken next. */
static mn_code turn_over(rounds *r) {
    close_deal(r);
    close_tiles(r, r->now);
    mni_frozen_copy(&r->frozen, &r->told);
    mn_code code = mni_tiles_finish(r->next, r->cell_vertices, r->st);
    if (code != MN_OK)
        return code;
    mni_tiles *taken = r->now;
    r->now = r->next;
    r->next = taken;
    r->vertices = (uint32_t)r->now->vertices;
    r->simplices = r->now->simplices;
    r->cells = r->now->cells;
    return MN_OK;
}

/* After a slow round without rings: whether the next one is to be another. */
static bool stays_in_order(rounds *r, uint32_t before, bool stuck) {
    uint64_t most = r->mesh->vertices + (uint64_t)SLOW_CELLS * r->desc.cell_vertices;
    r->slow_vertices += before;
    r->stuck = stuck ? r->stuck + 1 : 0;
    return r->stuck < STUCK_ROUNDS_IN_ORDER && r->slow_vertices <= most;
}

/* From the next round on vertices are points (put_aside). */
static void set_aside(rounds *r) {
    r->stage = 4;
    r->order = RINGS;
    r->aside.all = true;
}

/* What nothing else helps: the model is cut into fewer cells, or not any more. */
static void grow(rounds *r) {
    if (r->cell_vertices < GROWN_MAX * r->desc.cell_vertices)
        r->cell_vertices *= 2;
    else
        set_aside(r);
}

static void loosen_stage(rounds *r) {
    r->stuck = r->vain = 0;
    if (r->stage == 3) {
        grow(r);
        return;
    }
    r->stage++;
    r->order = RINGS;
    r->carrying_order = IN_ORDER;
}

/* By what could go in this round: the least order in which enough of it does. */
static uint32_t least_order(const rounds *r, uint32_t before) {
    uint64_t all = 0, some = 0;
    for (int level = 0; level < MNI_LEVELS; level++)
        all += r->could_go[level];
    uint64_t enough = all / 2 < before / SLOW_PART ? all / 2 : before / SLOW_PART;
    uint32_t order = IN_ORDER;
    while (order < LOOSEST && (some += r->could_go[level_of(order)]) < enough)
        order++;
    return order;
}

/* Whether it has nothing to do with the order that so few have gone. */
static bool in_vain(const rounds *r, uint32_t order, uint32_t before) {
    uint64_t all = 0;
    for (int level = 0; level < MNI_LEVELS; level++)
        all += r->could_go[level];
    return order == LOOSEST || all * STUCK_PART < before;
}

/* After a slow round in the order *of; those that carry hubs have one of their own. */
static void loosen(rounds *r, uint32_t *of, uint32_t before, bool stuck) {
    uint32_t least = least_order(r, before);
    if (!stuck || !in_vain(r, *of, before)) {
        r->stuck = of == &r->order ? 0 : r->stuck;
        r->vain = 0;
        *of = stuck && least <= *of ? *of + 1 : least;
    } else if (++r->vain < VAIN_ROUNDS) {
        r->carries = r->frozen.count > 0;
    } else {
        loosen_stage(r);
    }
}

/* One cell has all that is left, but for what is aside: nothing waits but for stages to come. */
static void go_on_alone(rounds *r) {
    if (r->lone && r->stage == 3)
        set_aside(r);
    else if (r->lone)
        r->stage++;
    r->lone = r->carries = true;
    r->order = RINGS;
    r->carrying_order = IN_ORDER;
}

/* What the next round is to do, by what this one has done. */
static void go_on(rounds *r, uint32_t before, uint32_t made) {
    bool slow = (uint64_t)made * SLOW_PART < before, fair = (uint64_t)made * FAIR_PART >= before;
    bool stuck = (uint64_t)made * STUCK_PART < before;
    if (r->stage == 4)
        return;
    bool inside = (uint64_t)r->inside * 2 > before, carried = r->carries;
    uint32_t *of = carried ? &r->carrying_order : &r->order;
    r->apart = (uint64_t)r->inside * INSIDE_PART < before ? r->apart + 1 : 0;
    r->carries = false;
    if (largest_cell(r) > usual_bytes((uint64_t)GROWN_MAX * r->desc.cell_vertices) ||
        (r->aside.count > 0 && r->simplices == 0)) {
        set_aside(r);
    } else if (r->aside.count > 0 && r->cells == 1) {
        go_on_alone(r);
    } else if (r->simplices == 0) {
        r->stage = 4;
        r->history->counts.components = r->vertices + r->frozen.count;
    } else if (!slow) {
        if (*of > IN_ORDER)
            *of = least_order(r, before);
        else if (fair)
            *of = RINGS;
        r->stuck = r->vain = 0;
    } else if (r->apart >= APART_ROUNDS) {
        r->apart = 0;
        grow(r);
    } else if (stuck && inside && r->frozen.count > 0) { /* it is hubs that all wait for */
        r->carries = !carried;
        if (carried)
            loosen_stage(r);
    } else if (*of == RINGS) {
        *of = IN_ORDER;
        r->stuck = 0;
    } else if (carried || *of > IN_ORDER || !stays_in_order(r, before, stuck)) {
        loosen(r, of, before, stuck);
    }
}

/* Where there are more simplices than a surface has, cells are as much smaller. */
static uint32_t count_cells(const rounds *r) {
    uint64_t usual = (uint64_t)r->vertices * 5 / 2 + 1, size = r->cell_vertices;
    if (r->simplices > usual)
        size = size * usual / r->simplices + 1;
    return (uint32_t)((r->vertices + size - 1) / size);
}

static uint64_t largest_dealt(const rounds *r) {
    uint64_t most = 0;
    for (uint32_t c = 0; c < r->cells; c++) {
        uint32_t vertices, triangles;
        mni_deal_counts(r->deal, c, &vertices, &triangles);
        uint64_t bytes = mni_cell_dealt_bytes((uint64_t)vertices + r->frozen.count, triangles);
        most = bytes > most ? bytes : most;
    }
    return most;
}

static mn_code try_deal(rounds *r) {
    const uint32_t cells = count_cells(r);
    mni_deal_desc desc = {.cells = cells,
                          .triangles_max = cells > 1 ? DENSE_PART * r->cell_vertices : 0,
                          .sample_every = r->sample_every,
                          .hub_fan = cells > 1 && r->cell_vertices >= HUB_CELLS_MIN
                                         ? (uint32_t)(HUB_FAN * r->cell_vertices)
                                         : 0,
                          .hubs_max = (uint32_t)(HUBS_MAX * r->cell_vertices),
                          .work_bytes = share_of(r, deal_share, DEAL_BYTES, MNI_DEAL_WORK_MIN),
                          .temp_dir = r->desc.temp_dir,
                          .watch = {r->desc.progress, r->desc.progress_context}};
    mn_code code = mni_deal_open(&r->deal, r->mesh, &desc, r->st);
    if (code != MN_OK)
        return code;
    r->cells = mni_deal_cells(r->deal);
    mni_deal_box(r->deal, r->low, r->high);
    r->step = mni_deal_step(r->deal);
    uint32_t hubs;
    const mni_ghost *hub = mni_deal_hubs(r->deal, &hubs);
    if (!mni_frozen_open(&r->frozen, hub, hubs) || !mni_frozen_open(&r->told, hub, hubs))
        return mn_fail(r->st, MN_FAILED, "out of memory for %u hubs", hubs);
    return MN_OK;
}

static mn_code open_deal(rounds *r) {
    mn_code code = try_deal(r);
    uint64_t largest = code == MN_OK ? largest_dealt(r) : 0;
    if (code == MN_OK)
        code = make_room(r, largest);
    if (code == MN_OK)
        code = check_room(r, largest);
    if (code != MN_OK || r->desc.work_bytes == 0 || largest <= r->usual_cells)
        return code;
    close_deal(r); /* once more, with less memory */
    mni_frozen_close(&r->frozen);
    mni_frozen_close(&r->told);
    return try_deal(r);
}

/* What tiles hold. */
static mn_code open_taken(rounds *r) {
    const uint64_t largest = largest_cell(r);
    mn_code code = make_room(r, largest);
    return code == MN_OK ? check_room(r, largest) : code;
}

static mn_code put_parcel(void *context, const mni_parcel *head, const unsigned char *simplices,
                          mn_status *st) {
    rounds *r = context;
    mn_code code = mni_aside_put(&r->aside, head, simplices, r->step, st);
    return code == MN_OK ? tell(r, st) : code;
}

/* All simplices that are left, once vertices are points; if there will be room to end in. */
static mn_code put_aside(rounds *r) {
    const uint64_t vertices = (uint64_t)r->vertices + r->frozen.count;
    const uint64_t least = mni_aside_least(vertices);
    if (r->desc.work_bytes > 0 && r->desc.work_bytes < least)
        return mn_fail(r->st, MN_CAP_TOO_SMALL,
                       "%llu vertices that cannot be cut into parts take %llu MB; try %s %lluM",
                       (unsigned long long)vertices, mni_megabytes(least),
                       mni_cap_option(&r->desc.cap),
                       mni_cap_megabytes(&r->desc.cap, enough_for(r, 0, false)));
    r->simplices = 0;
    return mni_tiles_shed(r->now, put_parcel, r, r->st);
}

static mn_code all_rounds(rounds *r) {
    mn_code code = MN_OK;
    r->stage = 1;
    r->carrying_order = IN_ORDER;
    for (r->round = 0; code == MN_OK && !r->whole; r->round++) {
        uint32_t before = r->history->collapses, vertices = r->vertices;
        code = r->round == 0 ? open_deal(r) : open_taken(r);
        r->whole = r->cells == 1 && (r->aside.count == 0 || r->aside.all);
        if (code == MN_OK && !r->whole)
            code = open_next(r);
        if (code == MN_OK)
            code = run_round(r);
        if (code == MN_OK && !r->whole)
            code = turn_over(r);
        bool all = r->aside.all;
        if (code == MN_OK && !r->whole)
            go_on(r, vertices, r->history->collapses - before);
        if (code == MN_OK && r->aside.all && !all)
            code = put_aside(r);
    }
    r->history->counts.rounds = r->round;
    return code;
}

/* What the rounds have taken is given back first. */
static mn_code finish_aside(rounds *r) {
    const mni_poll poll = {go_on_with, r};
    close_samples(r);
    close_tiles(r, r->now);
    close_tiles(r, r->next);
    return mni_aside_finish(&r->aside, r->history, r->desc.work_bytes, r->desc.temp_dir, &poll,
                            r->st);
}

uint64_t mni_rounds_work_min(uint32_t cell_vertices) {
    return usual_bytes(cell_vertices > 0 ? cell_vertices : MNI_CELL_VERTICES) + REST_BYTES_MIN;
}

uint32_t mni_rounds_cells_for(uint32_t cell_vertices, uint64_t work_bytes) {
    uint32_t cells = cell_vertices > 0 ? cell_vertices : MNI_CELL_VERTICES;
    while (work_bytes > 0 && cells > CELL_VERTICES_MIN && mni_rounds_work_min(cells) > work_bytes)
        cells /= 2;
    return cells;
}

/* Threads where there is room for their cells. Most are smaller than what is usual at most, and who
 * has no room waits. */
static void plan_memory(rounds *r) {
    mni_rounds_desc *d = &r->desc;
    d->threads = d->threads == 0 ? 1 : d->threads < THREADS_MAX ? d->threads : THREADS_MAX;
    r->threads_most = d->threads;
    r->cells_most = d->cell_vertices_most > 0 ? d->cell_vertices_most : MNI_CELL_VERTICES;
    d->cell_vertices = d->cell_vertices > 0 ? d->cell_vertices : MNI_CELL_VERTICES;
    r->cells_most = r->cells_most > d->cell_vertices ? r->cells_most : d->cell_vertices;
    r->cell_vertices = d->cell_vertices; /* which may grow */
    r->sample_every = r->cell_vertices * 100 / (LEFT_PERCENT * CELL_TILES * TILE_SAMPLES);
    r->sample_every = r->sample_every > 0 ? r->sample_every : 1;
    r->cells_bytes = UINT64_MAX / 2;
    if (d->work_bytes == 0)
        return;
    uint64_t one = usual_bytes(r->cell_vertices);
    while (d->threads > 1 && one * d->threads * 3 / 4 > d->work_bytes - REST_BYTES_LEAST)
        d->threads--;
    uint64_t tiles = (uint64_t)r->vertices * LEFT_PERCENT / 100 * CELL_TILES / r->cell_vertices;
    uint64_t tables = tiles * TILE_BYTES < TABLES_MAX ? tiles * TILE_BYTES : TABLES_MAX;
    uint64_t work = d->work_bytes - (d->threads - 1) * THREAD_BYTES - tables;
    r->all_bytes = work;
    r->usual_cells = r->cells_bytes = cells_share(r, work);
    r->rest_bytes = work - r->cells_bytes;
}

mn_code mni_rounds(mni_extmesh *mesh, const mni_rounds_desc *desc, mni_history *out,
                   mn_status *st) {
    rounds r = {.mesh = mesh,
                .desc = *desc,
                .st = st,
                .history = out,
                .aside = MNI_ASIDE_CLOSED,
                .now = &r.tiles[0],
                .next = &r.tiles[1],
                .tiles = {MNI_TILES_CLOSED, MNI_TILES_CLOSED},
                .vertices = (uint32_t)mesh->vertices,
                .simplices = mesh->triangles,
                .lock = PTHREAD_MUTEX_INITIALIZER,
                .turn = PTHREAD_COND_INITIALIZER};
    uint64_t least = mni_rounds_work_min(desc->cell_vertices);
    *out = MNI_HISTORY_CLOSED;
    if (desc->work_bytes > 0 && desc->work_bytes < least)
        return mn_fail(st, MN_CAP_TOO_SMALL, "simplifying needs %s %lluM",
                       mni_cap_option(&desc->cap), mni_cap_megabytes(&desc->cap, least));
    uint64_t read_before = mesh->vertex.bytes_read + mesh->triangle.bytes_read;
    MN_ASSERT(mesh->vertices > 1 && mesh->vertices < MNI_COLLAPSE);
    plan_memory(&r);
    mn_code code = mni_history_open(out, desc->temp_dir, desc->keep, st);
    if (code == MN_OK)
        code = mni_aside_open(&r.aside, desc->temp_dir, st);
    if (code == MN_OK)
        code = all_rounds(&r);
    if (code == MN_OK && r.aside.all)
        code = finish_aside(&r);
    if (code == MN_OK)
        code = mni_history_end(out, st);
    close_deal(&r);
    close_samples(&r);
    close_tiles(&r, &r.tiles[0]);
    close_tiles(&r, &r.tiles[1]);
    mni_frozen_close(&r.frozen);
    mni_frozen_close(&r.told);
    mni_aside_close(&r.aside);
    malloc_trim(0);
    out->bytes_read += mesh->vertex.bytes_read + mesh->triangle.bytes_read - read_before;
    out->bytes_written +=
        out->collapse.bytes_written + out->killed.bytes_written + out->group.bytes_written;
    if (code != MN_OK)
        mni_history_close(out);
    return code;
}
