/* See rounds.h. Hidden here: what goes from round to round, and who may take the next cell.
 *
 * A vertex travels under its key on the next curve, with how far its neighbours' reach; a
 * simplex under that of its first corner on the curve. So a cell is filled from sorted streams
 * alone, one after the other:
 *
 *   vertices:   v v v v v v v | v v v v v v v | …      cut after so many
 *   sights:     (vertex, reach seen from another cell) join their vertex
 *   simplices:  those whose first corner is in the cell; one whose other corners are not goes
 *               on to the next round as it is, and its corners get sights
 *
 * A vertex is at the border when a neighbour's key is not inside the cell's. The first round's
 * cells are dealt (deal.h).
 *
 * Threads. Cells are filled in turn and numbered in turn, under the lock; a thread then works on
 * its cell alone, and has sorts of its own for what is left of it. Every record says by its
 * key where it belongs among all, so it does not matter into which sort it went:
 *
 *   thread 0:  sorts ─┐
 *   thread 1:  sorts ─┴─► read side by side, the least key first: the next round's streams */
#include "rounds.h"

#include <malloc.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "curve.h"
#include "deal.h"
#include "extsort.h"

/* Where costs rise evenly over a whole region, all of it is put off, from the cells' edges inwards.
 * After a round with fewer collapses than this part of its vertices the next may be so much out of
 * order, and at last as it likes; from there on it is stricter again, round by round. */
enum { SLOW_PART = 8 };
static const float slack[] = {1, 4, INFINITY};
enum { SLACKS = sizeof slack / sizeof slack[0] };
/* Two rounds without order that make fewer than this part: the stage is as good as done, and the
 * next one allows more. In the last one nothing but cells that grow helps (every vertex joined to
 * places all over the model). */
enum { STUCK_PART = 64, STUCK_ROUNDS = 2 };

/* Of what is left beside the usual cells, this share is for those that are not; where that is
 * little, more, up to half a cell: the Earth's poles, of 4,320 triangles each, take a third more
 * than is usual, and 16 MB must do for them. */
static const double SPARE_SHARE = 0.125, SPARE_SHARE_MAX = 0.4;

enum { THREADS_MAX = 16, MMAP_BYTES = 64 << 10 };

enum { VERTICES, SIMPLICES, SIGHTS, STREAMS };
static const uint32_t record_bytes[STREAMS] = {sizeof(mni_wire_vertex), sizeof(mni_wire_simplex),
                                               sizeof(mni_wire_sight)};
/* Of the memory for sorting, what each may have. While a round goes on there are two of each. */
static const double stream_share[STREAMS] = {0.27, 0.21, 0.02};

/* What all threads put away, in one order. */
typedef struct stream {
    mni_sort *sort[THREADS_MAX];
    const void *next[THREADS_MAX]; /* NULL: that was all */
    uint32_t least;                /* the sort whose record is next */
} stream;

typedef struct rounds {
    /* const while a round goes on */
    mni_extmesh *mesh;
    mni_rounds_desc desc;
    mni_curve curve, next_curve;
    float low[3], high[3];
    uint32_t round;
    bool whole;           /* the last one */
    uint64_t sort_bytes;  /* memory for sorting; 0: no bound */
    uint64_t cells_bytes; /* for cells, all threads together */
    int stage;
    uint32_t slack, stuck; /* index of slack[]; rounds */
    uint32_t cell_vertices;
    uint32_t vertices, cells; /* of this round */
    uint64_t simplices;
    /* one for each thread, its own */
    mni_sort *next[STREAMS][THREADS_MAX];
    /* guarded by lock */
    pthread_mutex_t lock;
    pthread_cond_t turn;
    stream now[STREAMS];
    mni_deal *deal;                            /* the first round's */
    uint32_t threads_started, taken, numbered; /* cells */
    bool taking;
    uint64_t used_bytes; /* by the cells that are open */
    mni_history *history;
    mn_code code;
    mn_status *st;
} rounds;

/* For so many records, if memory has room for all of them; otherwise for a share of it. */
static mni_sort_desc sort_desc(const rounds *r, int which, uint64_t records) {
    uint64_t all = 2 * (records + 64) * record_bytes[which] + 2 * MNI_SORT_BUDGET_MIN;
    double share = stream_share[which] / r->desc.threads;
    uint64_t budget = r->sort_bytes == 0 ? all : (uint64_t)(share * (double)r->sort_bytes);
    budget = budget < all ? budget : all;
    return (mni_sort_desc){.record_bytes = record_bytes[which],
                           .key = MNI_SORT_U128,
                           .budget_bytes =
                               budget > MNI_SORT_BUDGET_MIN ? budget : MNI_SORT_BUDGET_MIN,
                           .temp_dir = r->desc.temp_dir};
}

/* Finds the least of the sorts' next records. */
static void choose(const rounds *r, stream *s) {
    s->least = 0;
    for (uint32_t i = 1; i < r->desc.threads; i++) {
        const void *least = s->next[s->least], *next = s->next[i];
        if (next != NULL && (least == NULL || mni_wire_order(next, least) < 0))
            s->least = i;
    }
}

static const void *peek(const stream *s) {
    return s->next[s->least];
}

static void advance(rounds *r, int which) {
    stream *s = &r->now[which];
    s->next[s->least] = mni_sort_next(s->sort[s->least], r->st);
    choose(r, s);
}

/* ---- filling a cell ------------------------------------------------------------------------- */

/* What the streams had for a cell, and the cell. */
typedef struct job {
    mni_hand hand;
    mni_wire_vertex *vertex;
    mni_wire_simplex *simplex;
    uint32_t vertices, simplices, simplices_room;
    uint64_t bytes; /* at its peak */
    mni_cell cell;
} job;

static uint32_t cell_start(const rounds *r, uint32_t c) {
    return (uint32_t)((uint64_t)r->vertices * c / r->cells);
}

/* Under the lock: the cell's vertices, with all that has been seen of their neighbours. */
static mn_code take_vertices(rounds *r, uint32_t c, job *j) {
    j->vertices = cell_start(r, c + 1) - cell_start(r, c);
    j->vertex = malloc(j->vertices * sizeof *j->vertex);
    if (j->vertex == NULL)
        return mn_fail(r->st, MN_FAILED, "out of memory for a cell of %u vertices", j->vertices);
    for (uint32_t v = 0; v < j->vertices; v++) {
        const mni_wire_vertex *from = peek(&r->now[VERTICES]);
        const mni_wire_sight *s;
        if (from == NULL) /* the stream has failed: as many are there as were counted */
            return r->st->code;
        mni_wire_vertex *to = &j->vertex[v];
        *to = *from;
        advance(r, VERTICES);
        while ((s = peek(&r->now[SIGHTS])) != NULL && s->at.id == to->at.id &&
               s->at.key == to->at.key) {
            mni_wire_extend(&to->reach, s->reach);
            advance(r, SIGHTS);
        }
    }
    return r->st->code;
}

/* Of a cell of so many vertices of a surface, with what comes from beside it. */
static uint64_t usual_bytes(uint64_t vertices) {
    return mni_cell_bytes(vertices + vertices / 16, 2 * vertices + vertices / 3);
}

/* What cells get of so much memory; rises with it, and with the threads. */
static uint64_t cells_share(const rounds *r, uint64_t work_bytes) {
    uint64_t one = usual_bytes(r->desc.cell_vertices), usual = one * r->desc.threads;
    double rest = (double)(work_bytes - usual);
    double some = fmin(SPARE_SHARE_MAX * rest, (double)one / 2);
    return usual + (uint64_t)fmax(some, SPARE_SHARE * rest);
}

/* Under the lock: whether such a cell fits at all. */
static mn_code check_room(const rounds *r, uint64_t bytes) {
    if (bytes <= r->cells_bytes)
        return MN_OK;
    uint64_t work = r->desc.work_bytes;
    while (cells_share(r, work) < bytes)
        work += work / 64;
    uint64_t all = (MNI_PROGRAM_BYTES + work) / 10 * 11; /* a part is kept in hand (vdt.c) */
    return mn_fail(r->st, MN_CAP_TOO_SMALL,
                   "a part of the model that cannot be cut takes %llu MB; try --ram %lluM",
                   (unsigned long long)(bytes >> 20), (unsigned long long)((all >> 20) + 1));
}

/* Under the lock: the simplices whose first corner is in the cell. */
static mn_code take_simplices(rounds *r, job *j) {
    mni_wire_head last = j->vertex[j->vertices - 1].at;
    const mni_wire_simplex *from;
    last.number = UINT32_MAX;
    j->simplices = 0;
    while ((from = peek(&r->now[SIMPLICES])) != NULL && mni_wire_order(&from->at, &last) <= 0) {
        if (j->simplices == j->simplices_room) {
            uint32_t room = j->simplices_room + j->simplices_room / 4 + 2 * j->vertices + 64;
            if (check_room(r, mni_cell_bytes(j->vertices, j->simplices)) != MN_OK)
                return r->st->code;
            mni_wire_simplex *more = realloc(j->simplex, room * sizeof *more);
            if (more == NULL)
                return mn_fail(r->st, MN_FAILED, "out of memory for %u simplices", room);
            j->simplex = more;
            j->simplices_room = room;
        }
        j->simplex[j->simplices++] = *from;
        advance(r, SIMPLICES);
    }
    return r->st->code;
}

static mn_code take_records(rounds *r, uint32_t c, job *j) {
    if (r->round == 0) {
        mn_code code = mni_deal_next(r->deal, &j->hand, r->st);
        j->bytes = mni_cell_bytes(j->hand.vertices + j->hand.ghosts, j->hand.triangles);
        return code;
    }
    mn_code code = take_vertices(r, c, j);
    if (code == MN_OK)
        code = take_simplices(r, j);
    j->bytes = mni_cell_bytes(j->vertices, j->simplices);
    return code;
}

/* Under the lock; one thread at a time. Waits until there is room for the cell beside those that
 * are open: these do not wait for it. */
static mn_code take_cell(rounds *r, uint32_t *c, job *j) {
    while (r->taking)
        pthread_cond_wait(&r->turn, &r->lock);
    j->bytes = 0;
    *c = r->taken;
    if (r->taken == r->cells || r->code != MN_OK)
        return r->code;
    r->taking = true;
    r->taken++;
    mn_code code = take_records(r, *c, j);
    if (code == MN_OK)
        code = check_room(r, j->bytes);
    while (code == MN_OK && r->used_bytes + j->bytes > r->cells_bytes && r->used_bytes > 0)
        pthread_cond_wait(&r->turn, &r->lock);
    r->used_bytes += j->bytes;
    r->taking = false;
    pthread_cond_broadcast(&r->turn);
    return code;
}

/* ---- what goes on to the next round --------------------------------------------------------- */

typedef struct outlet {
    const mni_curve *curve;
    mni_sort *vertices, *simplices, *sights;
} outlet;

static outlet outlet_of(const rounds *r, uint32_t thread) {
    return (outlet){&r->next_curve, r->next[VERTICES][thread], r->next[SIMPLICES][thread],
                    r->next[SIGHTS][thread]};
}

static int corners_of(const mni_wire_simplex *x) {
    return x->v[2] == MN_NONE ? 2 : 3;
}

/* The places and numbers of x are set; keys: of its corners on the next curve. Returns the range of
 * these. */
static mni_wire_range send_simplex(const outlet *o, mni_wire_simplex *x, const uint64_t keys[3]) {
    mni_wire_head first = {.key = UINT64_MAX, .id = UINT32_MAX, .number = x->at.number};
    mni_wire_range range = mni_wire_nothing;
    for (int c = 0; c < corners_of(x); c++) {
        mni_wire_head at = {.key = keys[c], .number = x->at.number, .id = x->v[c]};
        mni_wire_widen(&range, (mni_wire_range){keys[c], keys[c]});
        if (mni_wire_order(&at, &first) < 0)
            first = at;
    }
    x->at = first;
    mni_sort_put(o->simplices, x);
    return range;
}

static void send_sight(const outlet *o, uint32_t id, uint64_t key, mni_wire_range range) {
    mni_wire_sight s = {.at = {.key = key, .id = id}, .reach = mni_wire_reach_of(key, range)};
    mni_sort_put(o->sights, &s);
}

/* Of simplices between cells no cell knows all corners: each is told of the others. */
static void give_passing(const outlet *o, mni_wire_simplex *x, uint32_t count) {
    for (; count > 0; count--, x++) {
        uint64_t keys[3];
        for (int c = 0; c < corners_of(x); c++)
            keys[c] = mni_curve_place_key(o->curve, x->place[c]);
        mni_wire_range range = send_simplex(o, x, keys);
        for (int c = 0; c < corners_of(x); c++)
            send_sight(o, x->v[c], keys[c], range);
    }
}

/* Where a vertex is on the next curve, and what its simplices see. */
typedef struct standing {
    uint64_t place, key;
    mni_wire_range range;
} standing;

static void give_simplices(const outlet *o, const mni_cell *cell, standing *stands) {
    for (uint32_t x = 0; x < cell->s.surface.simplices; x++) {
        const uint32_t *v = cell->s.surface.simplex[x].v;
        mni_wire_simplex out;
        uint64_t keys[3];
        if (!mni_cell_simplex(cell, x, &out))
            continue;
        for (int c = 0; c < corners_of(&out); c++) {
            out.place[c] = stands[v[c]].place;
            keys[c] = stands[v[c]].key;
        }
        mni_wire_range range = send_simplex(o, &out, keys);
        for (int c = 0; c < corners_of(&out); c++) {
            mni_wire_widen(&stands[v[c]].range, range);
            if (v[c] >= cell->own)
                send_sight(o, out.v[c], keys[c], range);
        }
    }
}

/* What is left of a cell. */
static mn_code give_cell(const outlet *o, const mni_cell *cell, mn_status *st) {
    standing *stands = malloc(cell->vertices * sizeof *stands);
    if (stands == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for a cell");
    for (uint32_t v = 0; v < cell->vertices; v++)
        if (v >= cell->own || cell->s.surface.vertex[v].node != MN_NONE) {
            uint64_t place = mni_curve_place(o->curve, cell->s.surface.vertex[v].p);
            stands[v] = (standing){place, mni_curve_place_key(o->curve, place), mni_wire_nothing};
        }
    give_simplices(o, cell, stands);
    for (uint32_t v = 0; v < cell->own; v++) {
        mni_wire_vertex out;
        if (!mni_cell_vertex(cell, v, &out))
            continue;
        out.at.key = stands[v].key;
        out.reach = mni_wire_reach_of(out.at.key, stands[v].range);
        mni_sort_put(o->vertices, &out);
    }
    free(stands);
    return MN_OK;
}

static void free_job(job *j) {
    mni_cell_close(&j->cell);
    mni_hand_free(&j->hand);
    free(j->vertex);
    free(j->simplex);
    *j = (job){0};
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

static mn_code tell(const rounds *r, mn_status *st) {
    if (r->desc.progress == NULL || r->desc.progress(r->desc.progress_context, "simplify",
                                                     r->history->collapses, r->mesh->vertices))
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

/* Under the lock: what a cell has made gets its numbers, cell by cell. */
static mn_code number_cell(rounds *r, uint32_t c, mni_cell *cell, mn_status *st) {
    while (r->numbered != c && r->code == MN_OK)
        pthread_cond_wait(&r->turn, &r->lock);
    if (r->code != MN_OK)
        return r->code;
    mni_cell_number(cell, r->history->collapses, r->history->hinges);
    mn_code code = mni_history_add(r->history, cell, st);
    if (code == MN_OK && r->whole)
        keep_root(r, cell);
    r->numbered++;
    pthread_cond_broadcast(&r->turn);
    return code == MN_OK ? tell(r, st) : code;
}

/* What was taken becomes a cell. */
static mn_code open_cell(const rounds *r, uint32_t thread, job *j, mn_status *st) {
    mni_cell_desc desc = {
        .metric = r->desc.metric, .whole = r->whole, .stage = r->stage, .slack = slack[r->slack]};
    if (r->round == 0)
        return mni_cell_open_dealt(&j->cell, &desc, &j->hand, st);
    outlet o = outlet_of(r, thread);
    uint32_t passing;
    mn_code code = mni_cell_open_taken(&j->cell, &desc, &j->vertex, j->vertices, &j->simplex,
                                       j->simplices, &passing, st);
    give_passing(&o, j->simplex, passing);
    free(j->simplex);
    j->simplex = NULL;
    j->simplices_room = 0;
    return code;
}

/* Under the lock, which it leaves while it works. */
static mn_code do_cell(rounds *r, uint32_t thread, job *j, mn_status *st) {
    uint32_t c;
    outlet o = outlet_of(r, thread);
    mn_code code = take_cell(r, &c, j);
    if (code != MN_OK)
        *st = *r->st;
    if (code != MN_OK || c == r->cells) {
        r->used_bytes -= j->bytes;
        return code;
    }
    pthread_mutex_unlock(&r->lock);
    if (code == MN_OK)
        code = open_cell(r, thread, j, st);
    if (code == MN_OK)
        code = mni_cell_run(&j->cell, st);
    pthread_mutex_lock(&r->lock);
    if (code == MN_OK)
        code = number_cell(r, c, &j->cell, st);
    pthread_mutex_unlock(&r->lock);
    if (code == MN_OK && !r->whole)
        code = give_cell(&o, &j->cell, st);
    mni_cell_close(&j->cell);
    pthread_mutex_lock(&r->lock);
    r->used_bytes -= j->bytes;
    pthread_cond_broadcast(&r->turn);
    return code;
}

/* Sorts of the thread's own are closed for putting where they were filled. */
static mn_code finish_sorts(rounds *r, uint32_t thread, mn_status *st) {
    mn_code code = MN_OK;
    for (int i = 0; i < STREAMS && code == MN_OK; i++)
        code = mni_sort_finish(r->next[i][thread], st);
    return code;
}

static void *worker(void *context) {
    rounds *r = context;
    job j = {0};
    mn_status st = {0};
    pthread_mutex_lock(&r->lock);
    uint32_t thread = r->threads_started++;
    mn_code code = MN_OK;
    while (r->taken < r->cells && r->code == MN_OK && code == MN_OK) {
        code = do_cell(r, thread, &j, &st);
        if (code != MN_OK)
            fail(r, &st);
    }
    code = r->code;
    pthread_mutex_unlock(&r->lock);
    free_job(&j);
    if (code == MN_OK && finish_sorts(r, thread, &st) != MN_OK) {
        pthread_mutex_lock(&r->lock);
        fail(r, &st);
        pthread_mutex_unlock(&r->lock);
    }
    return NULL;
}

/* ---- rounds --------------------------------------------------------------------------------- */

/* A round can hardly have more hinges, or simplices between cells, than the room that is left for
 * them here; if it has, they are sorted on disk. */
static mn_code open_next(rounds *r) {
    const uint64_t most[STREAMS] = {r->vertices, 2 * (uint64_t)r->vertices + r->vertices / 4,
                                    r->vertices / 2};
    mn_code code = MN_OK;
    for (int i = 0; i < STREAMS; i++)
        for (uint32_t t = 0; t < r->desc.threads && code == MN_OK; t++) {
            mni_sort_desc desc = sort_desc(r, i, most[i]);
            code = mni_sort_open(&r->next[i][t], &desc, r->st);
        }
    return code;
}

/* All threads have sorts, so each has to run, if only to finish them. */
static mn_code run_round(rounds *r) {
    pthread_t thread[THREADS_MAX];
    uint32_t started = 0;
    r->taken = r->numbered = r->threads_started = 0;
    while (started + 1 < r->desc.threads && pthread_create(&thread[started], NULL, worker, r) == 0)
        started++;
    for (uint32_t i = started; i < r->desc.threads; i++)
        worker(r);
    while (started > 0)
        pthread_join(thread[--started], NULL);
    return r->code;
}

static void close_stream(rounds *r, int which) {
    for (uint32_t t = 0; t < r->desc.threads; t++) {
        mni_sort *sort = r->now[which].sort[t];
        if (sort != NULL) {
            mni_sort_figures f = mni_sort_figures_get(sort);
            r->history->bytes_read += f.bytes_read;
            r->history->bytes_written += f.bytes_written;
        }
        mni_sort_close(sort);
    }
    r->now[which] = (stream){0};
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

/* What was written is what is read next. */
static mn_code turn_over(rounds *r) {
    close_deal(r);
    for (int i = 0; i < STREAMS; i++) {
        uint64_t records = 0;
        close_stream(r, i);
        for (uint32_t t = 0; t < r->desc.threads; t++) {
            r->now[i].sort[t] = r->next[i][t];
            r->next[i][t] = NULL;
            r->now[i].next[t] = mni_sort_next(r->now[i].sort[t], r->st);
            records += mni_sort_figures_get(r->now[i].sort[t]).records;
        }
        choose(r, &r->now[i]);
        if (i == VERTICES)
            r->vertices = (uint32_t)records;
        if (i == SIMPLICES)
            r->simplices = records;
    }
    return r->st->code;
}

/* What the next round is to do, by what this one has done. */
static void go_on(rounds *r, uint32_t before, uint32_t made) {
    if (r->stage == 4)
        return;
    if (r->simplices == 0) {
        r->stage = 4;
        r->history->counts.components = r->vertices;
    } else if ((uint64_t)made * SLOW_PART >= before) {
        r->slack -= r->slack > 0;
        r->stuck = 0;
    } else if (r->slack + 1 < SLACKS) {
        r->slack++;
    } else if ((uint64_t)made * STUCK_PART >= before) {
        r->stuck = 0;
    } else if (++r->stuck == STUCK_ROUNDS) {
        r->stuck = 0;
        if (r->stage < 3) {
            r->stage++;
            r->slack = 0;
        } else {
            r->cell_vertices *= 2;
        }
    }
}

/* Before much has been done. What later rounds need is less: a pole's ring comes in parts. */
static mn_code check_deal(const rounds *r) {
    uint64_t most = 0;
    for (uint32_t c = 0; c < r->cells; c++) {
        uint32_t vertices, triangles;
        mni_deal_counts(r->deal, c, &vertices, &triangles);
        uint64_t bytes = mni_cell_bytes(vertices, triangles);
        most = bytes > most ? bytes : most;
    }
    return check_room(r, most);
}

static mn_code open_deal(rounds *r) {
    uint64_t work = r->sort_bytes == 0 ? (uint64_t)64 << 20 : r->sort_bytes / 2;
    mni_deal_desc desc = {.cells = r->cells,
                          .work_bytes = work > MNI_DEAL_WORK_MIN ? work : MNI_DEAL_WORK_MIN,
                          .temp_dir = r->desc.temp_dir};
    mn_code code = mni_deal_open(&r->deal, r->mesh, &desc, r->st);
    if (code == MN_OK)
        mni_deal_box(r->deal, r->low, r->high);
    return code == MN_OK ? check_deal(r) : code;
}

/* Where there are more simplices than a surface has, cells are as much smaller. */
static uint32_t count_cells(const rounds *r) {
    uint64_t usual = (uint64_t)r->vertices * 5 / 2 + 1, size = r->cell_vertices;
    if (r->simplices > usual)
        size = size * usual / r->simplices + 1;
    return (uint32_t)((r->vertices + size - 1) / size);
}

static mn_code all_rounds(rounds *r) {
    mn_code code = MN_OK;
    r->stage = 1;
    for (r->round = 0; code == MN_OK && !r->whole; r->round++) {
        uint32_t before = r->history->collapses, vertices = r->vertices;
        r->cells = count_cells(r);
        r->whole = r->cells == 1;
        if (r->round == 0)
            code = open_deal(r);
        r->next_curve = mni_curve_make(r->low, r->high, r->round + 1);
        if (code == MN_OK)
            code = open_next(r);
        if (code == MN_OK)
            code = run_round(r);
        if (code == MN_OK)
            code = turn_over(r);
        if (code == MN_OK && !r->whole)
            go_on(r, vertices, r->history->collapses - before);
    }
    r->history->counts.rounds = r->round;
    return code;
}

enum { SORT_BYTES_MIN = 2 << 20 };

uint64_t mni_rounds_work_min(uint32_t cell_vertices) {
    return usual_bytes(cell_vertices > 0 ? cell_vertices : MNI_CELL_VERTICES) + SORT_BYTES_MIN;
}

/* Half of the memory for cells at most; threads only where there is room for their cells. */
static void plan_memory(rounds *r) {
    mni_rounds_desc *d = &r->desc;
    d->threads = d->threads == 0 ? 1 : d->threads < THREADS_MAX ? d->threads : THREADS_MAX;
    d->cell_vertices = d->cell_vertices > 0 ? d->cell_vertices : MNI_CELL_VERTICES;
    r->cell_vertices = d->cell_vertices; /* which may grow */
    r->cells_bytes = UINT64_MAX / 2;
    if (d->work_bytes == 0)
        return;
    uint64_t one = usual_bytes(r->cell_vertices);
    while (d->threads > 1 && one * d->threads > d->work_bytes / 2)
        d->threads--;
    r->cells_bytes = cells_share(r, d->work_bytes);
    r->sort_bytes = d->work_bytes - r->cells_bytes;
}

mn_code mni_rounds(mni_extmesh *mesh, const mni_rounds_desc *desc, mni_history *out,
                   mn_status *st) {
    rounds r = {.mesh = mesh,
                .desc = *desc,
                .st = st,
                .history = out,
                .vertices = (uint32_t)mesh->vertices,
                .simplices = mesh->triangles,
                .lock = PTHREAD_MUTEX_INITIALIZER,
                .turn = PTHREAD_COND_INITIALIZER};
    uint64_t least = mni_rounds_work_min(desc->cell_vertices);
    *out = MNI_HISTORY_CLOSED;
    if (desc->work_bytes > 0 && desc->work_bytes < least)
        return mn_fail(st, MN_CAP_TOO_SMALL, "simplifying needs --ram %lluM",
                       (unsigned long long)((least + MNI_PROGRAM_BYTES) >> 20) + 1);
    uint64_t read_before = mesh->vertex.bytes_read + mesh->triangle.bytes_read;
    MN_ASSERT(mesh->vertices > 1 && mesh->vertices < MNI_COLLAPSE);
    plan_memory(&r);
    /* What cells take comes and goes: a heap would keep it, and more with each cell. */
    mallopt(M_MMAP_THRESHOLD, MMAP_BYTES);
    mn_code code = mni_history_open(out, desc->temp_dir, desc->keep, st);
    if (code == MN_OK)
        code = all_rounds(&r);
    if (code == MN_OK)
        code = mni_history_end(out, st);
    close_deal(&r);
    for (int i = 0; i < STREAMS; i++) {
        close_stream(&r, i);
        for (int t = 0; t < THREADS_MAX; t++)
            mni_sort_close(r.next[i][t]);
    }
    malloc_trim(0);
    out->bytes_read += mesh->vertex.bytes_read + mesh->triangle.bytes_read - read_before;
    out->bytes_written +=
        out->collapse.bytes_written + out->killed.bytes_written + out->group.bytes_written;
    if (code != MN_OK)
        mni_history_close(out);
    return code;
}
