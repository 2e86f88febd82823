/* See rounds.h. Hidden here: what goes from round to round, and who may take the next cell.
 *
 * A vertex travels under its key on the next curve, with the range of its neighbours' keys; a
 * simplex under that of its first corner on the curve. So a cell is filled from sorted streams
 * alone, one after the other:
 *
 *   vertices:   v v v v v v v | v v v v v v v | …      cut after so many
 *   sights:     (vertex, keys seen from another cell)  join their vertex
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
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "curve.h"
#include "deal.h"
#include "extsort.h"

static const double SHARE = 1; /* of what a cell could do, done in a round */
/* A round that makes fewer collapses than this part of its vertices is followed by one of cells
 * twice as large: costs that rise evenly over a whole region are put off from its edge inwards. */
enum { SLOW_PART = 8 };

enum { THREADS_MAX = 16 };

/* ---- what travels --------------------------------------------------------------------------- */

/* Where a record belongs: the key on the curve, then the vertex's id, which tells vertices in one
 * place apart, then what tells simplices of one vertex apart. */
typedef struct head {
    uint64_t key;
    uint32_t number, id; /* as the low half of a number of 128 bits */
} head;

static int by_head(const head *x, const head *y) {
    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return x->id < y->id ? -1 : x->id > y->id;
}

typedef struct vertex_record {
    head at;
    uint64_t low, high; /* keys of its neighbours, as far as its last cell saw them */
    mni_cell_vertex v;
} vertex_record;
_Static_assert(sizeof(vertex_record) <= MNI_SORT_RECORD_MAX, "a vertex can be sorted");

typedef struct simplex_record {
    head at; /* its first corner; number: its own */
    mni_cell_simplex x;
} simplex_record;

typedef struct sight {
    head at; /* a vertex */
    uint64_t low, high;
} sight;

enum { VERTICES, SIMPLICES, SIGHTS, STREAMS };
static const uint32_t record_bytes[STREAMS] = {sizeof(vertex_record), sizeof(simplex_record),
                                               sizeof(sight)};
/* Of the memory for sorting, what each may have. While a round goes on there are two of each. */
static const double stream_share[STREAMS] = {0.28, 0.2, 0.02};

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
    bool whole;          /* the last one */
    uint64_t sort_bytes; /* memory for sorting; 0: no bound */
    uint32_t cell_vertices, cell_vertices_max;
    uint32_t vertices, cells; /* of this round */
    /* one for each thread, its own */
    mni_sort *next[STREAMS][THREADS_MAX];
    /* guarded by lock */
    pthread_mutex_t lock;
    pthread_cond_t turn;
    stream now[STREAMS];
    mni_deal *deal;                            /* the first round's */
    uint32_t threads_started, taken, numbered; /* cells */
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
        const head *a = s->next[s->least], *b = s->next[i];
        if (b != NULL &&
            (a == NULL || b->key < a->key ||
             (b->key == a->key && (b->id < a->id || (b->id == a->id && b->number < a->number)))))
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

static uint64_t min_key(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

static uint64_t max_key(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

static int corners_of(const mni_cell_simplex *x) {
    return x->v[2] == MN_NONE ? 2 : 3;
}

/* The corners' keys, and which is first on the curve. */
static int first_corner(const mni_curve *curve, const mni_cell_simplex *x, head at[3]) {
    int first = 0;
    for (int c = 0; c < corners_of(x); c++) {
        at[c] = (head){.key = mni_curve_key(curve, x->p[c]), .id = x->v[c]};
        if (by_head(&at[c], &at[first]) < 0)
            first = c;
    }
    return first;
}

/* ---- where a vertex stands ------------------------------------------------------------------ */

/* Ids of a cell's vertices, hashed: open addresses, half of them free. */
typedef struct places {
    uint32_t *at; /* index; MN_NONE: free */
    uint32_t mask;
} places;

static uint32_t place_of(const places *p, const mni_cell *cell, uint32_t id) {
    uint32_t i = id * 0x9e3779b1u;
    for (i ^= i >> 15;; i++) {
        uint32_t at = p->at[i & p->mask];
        if (at == MN_NONE || cell->vertex[at].id == id)
            return at;
    }
}

static void place(places *p, const mni_cell *cell, uint32_t index) {
    uint32_t i = cell->vertex[index].id * 0x9e3779b1u;
    for (i ^= i >> 15; p->at[i & p->mask] != MN_NONE;)
        i++;
    p->at[i & p->mask] = index;
}

static bool places_open(places *p, uint32_t most) {
    uint32_t room = 64;
    while (room < 2 * most)
        room *= 2;
    p->mask = room - 1;
    p->at = malloc(room * sizeof *p->at);
    if (p->at != NULL)
        memset(p->at, 0xff, room * sizeof *p->at);
    return p->at != NULL;
}

/* ---- filling a cell ------------------------------------------------------------------------- */

/* A cell, what the streams had for it, and the simplices that go on to the next round as they are.
 */
typedef struct job {
    mni_hand hand;
    vertex_record *vertex;
    uint32_t vertices;
    simplex_record *simplex;
    uint32_t simplices, simplices_room, passing; /* passing: the first ones */
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
        const vertex_record *from = peek(&r->now[VERTICES]);
        const sight *s;
        if (from == NULL) /* the stream has failed: as many are there as were counted */
            return r->st->code;
        vertex_record *to = &j->vertex[v];
        *to = *from;
        advance(r, VERTICES);
        while ((s = peek(&r->now[SIGHTS])) != NULL && by_head(&s->at, &to->at) == 0) {
            to->low = min_key(to->low, s->low);
            to->high = max_key(to->high, s->high);
            advance(r, SIGHTS);
        }
    }
    return r->st->code;
}

/* Under the lock: the simplices whose first corner is in the cell. */
static mn_code take_simplices(rounds *r, job *j) {
    const head *last = &j->vertex[j->vertices - 1].at;
    const simplex_record *from;
    j->simplices = 0;
    while ((from = peek(&r->now[SIMPLICES])) != NULL && by_head(&from->at, last) <= 0) {
        if (j->simplices == j->simplices_room) {
            uint32_t room = j->simplices_room * 2 + 1024;
            simplex_record *more = realloc(j->simplex, room * sizeof *more);
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

static mn_code take_cell(rounds *r, uint32_t c, job *j) {
    if (r->round == 0)
        return mni_deal_next(r->deal, &j->hand, r->st);
    mn_code code = take_vertices(r, c, j);
    return code == MN_OK ? take_simplices(r, j) : code;
}

/* Simplices of which all corners are here, triangles first; the others to the front of j->simplex.
 */
static void settle_simplices(job *j, const places *p) {
    mni_cell *cell = &j->cell;
    j->passing = 0;
    for (int hinges = 0; hinges < 2; hinges++)
        for (uint32_t i = 0; i < j->simplices; i++) {
            mni_cell_simplex x = j->simplex[i].x;
            bool inside = true;
            if (i < j->passing || (x.v[2] == MN_NONE) != (hinges == 1))
                continue;
            for (int c = 0; c < 3; c++) {
                x.at[c] = x.v[c] == MN_NONE ? MN_NONE : place_of(p, cell, x.v[c]);
                inside &= x.v[c] == MN_NONE || x.at[c] != MN_NONE;
            }
            if (inside) {
                cell->simplex[cell->simplices++] = x;
            } else {
                simplex_record passing = j->simplex[i];
                j->simplex[i] = j->simplex[j->passing];
                j->simplex[j->passing++] = passing;
            }
        }
}

/* What was taken becomes a cell. */
static mn_code settle_cell(const rounds *r, job *j, mn_status *st) {
    mni_cell *cell = &j->cell;
    places p = {0};
    if (r->round == 0)
        return mni_hand_cell(&j->hand, cell, st);
    cell->vertex = malloc(j->vertices * sizeof *cell->vertex);
    cell->simplex = malloc(((size_t)j->simplices + 1) * sizeof *cell->simplex);
    cell->simplices_room = j->simplices + 1;
    if (cell->vertex == NULL || cell->simplex == NULL || !places_open(&p, j->vertices))
        return mn_fail(st, MN_FAILED, "out of memory for a cell of %u vertices", j->vertices);
    cell->vertices = j->vertices;
    uint64_t first = j->vertex[0].at.key, last = j->vertex[j->vertices - 1].at.key;
    for (uint32_t v = 0; v < cell->vertices; v++) {
        const vertex_record *from = &j->vertex[v];
        cell->vertex[v] = from->v; /* equal keys may be in the next cell */
        cell->vertex[v].border = !r->whole && (from->low <= first || from->high >= last);
        place(&p, cell, v);
    }
    free(j->vertex);
    j->vertex = NULL;
    settle_simplices(j, &p);
    free(p.at);
    return MN_OK;
}

/* ---- giving a cell back --------------------------------------------------------------------- */

/* Of a simplex between cells, of which no cell knows all corners: each is told of the others. */
static void send_sights(mni_sort *sights, const mni_curve *curve, const mni_cell_simplex *x) {
    head at[3];
    uint64_t low = UINT64_MAX, high = 0;
    first_corner(curve, x, at);
    for (int c = 0; c < corners_of(x); c++) {
        low = min_key(low, at[c].key);
        high = max_key(high, at[c].key);
    }
    for (int c = 0; c < corners_of(x); c++) {
        sight s = {at[c], low, high};
        mni_sort_put(sights, &s);
    }
}

/* What is left of a cell goes into the thread's sorts. */
static mn_code give_cell(rounds *r, uint32_t thread, job *j, mn_status *st) {
    const mni_cell *cell = &j->cell;
    const mni_curve *curve = &r->next_curve;
    mni_sort *vertices = r->next[VERTICES][thread], *simplices = r->next[SIMPLICES][thread],
             *sights = r->next[SIGHTS][thread];
    vertex_record *record = malloc(((size_t)cell->vertices + 1) * sizeof *record);
    if (record == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for a cell");
    for (uint32_t v = 0; v < cell->vertices; v++)
        record[v] = (vertex_record){
            .at = {.key = mni_curve_key(curve, cell->vertex[v].p), .id = cell->vertex[v].id},
            .low = UINT64_MAX,
            .v = cell->vertex[v]};
    for (uint32_t x = 0; x < cell->simplices; x++) {
        const mni_cell_simplex *s = &cell->simplex[x];
        uint64_t low = UINT64_MAX, high = 0;
        simplex_record to = {.x = *s};
        bool crosses = false;
        for (int c = 0; c < corners_of(s); c++) {
            head at = s->at[c] != MN_NONE
                          ? record[s->at[c]].at
                          : (head){.key = mni_curve_key(curve, s->p[c]), .id = s->v[c]};
            crosses |= s->at[c] == MN_NONE;
            low = min_key(low, at.key);
            high = max_key(high, at.key);
            if (c == 0 || by_head(&at, &to.at) < 0)
                to.at = at;
        }
        to.at.number = s->id;
        mni_sort_put(simplices, &to);
        if (crosses)
            send_sights(sights, curve, s);
        for (int c = 0; c < corners_of(s); c++)
            if (s->at[c] != MN_NONE) {
                record[s->at[c]].low = min_key(record[s->at[c]].low, low);
                record[s->at[c]].high = max_key(record[s->at[c]].high, high);
            }
    }
    for (uint32_t v = 0; v < cell->vertices; v++)
        mni_sort_put(vertices, &record[v]);
    free(record);
    return MN_OK;
}

static void give_passing(rounds *r, uint32_t thread, job *j) {
    for (uint32_t i = 0; i < j->passing; i++) {
        head at[3];
        simplex_record *x = &j->simplex[i];
        x->at = at[first_corner(&r->next_curve, &x->x, at)];
        x->at.number = x->x.id;
        mni_sort_put(r->next[SIMPLICES][thread], x);
        send_sights(r->next[SIGHTS][thread], &r->next_curve, &x->x);
    }
}

static void free_cell(job *j) {
    free(j->cell.vertex);
    free(j->cell.simplex);
    free(j->cell.collapse);
    free(j->cell.killed);
    j->cell = (mni_cell){0};
}

static void free_job(job *j) {
    free_cell(j);
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

/* Under the lock: what a cell has made gets its numbers, cell by cell. */
static mn_code number_cell(rounds *r, uint32_t c, mni_cell *cell, mn_status *st) {
    while (r->numbered != c && r->code == MN_OK)
        pthread_cond_wait(&r->turn, &r->lock);
    if (r->code != MN_OK)
        return r->code;
    mni_cell_number(cell, r->history->collapses, r->history->hinges);
    mn_code code = mni_history_add(r->history, cell, st);
    if (code == MN_OK && r->whole) {
        MN_ASSERT(cell->vertices == 1 && cell->simplices == 0);
        r->history->root_value = cell->vertex[0].value;
        r->history->root_levels = cell->vertex[0].levels;
    }
    r->numbered++;
    pthread_cond_broadcast(&r->turn);
    return code == MN_OK ? tell(r, st) : code;
}

/* Under the lock, which it leaves while it works. */
static mn_code do_cell(rounds *r, uint32_t thread, job *j, mn_status *st) {
    uint32_t c = r->taken++;
    mni_cell_desc desc = {.metric = r->desc.metric,
                          .first = r->round == 0,
                          .whole = r->whole,
                          .stage = 1,
                          .share = SHARE};
    mn_code code = take_cell(r, c, j);
    if (code != MN_OK)
        *st = *r->st;
    pthread_mutex_unlock(&r->lock);
    if (code == MN_OK)
        code = settle_cell(r, j, st);
    if (code == MN_OK) {
        give_passing(r, thread, j);
        code = mni_cell_run(&j->cell, &desc, st);
    }
    pthread_mutex_lock(&r->lock);
    if (code == MN_OK)
        code = number_cell(r, c, &j->cell, st);
    pthread_mutex_unlock(&r->lock);
    if (code == MN_OK && !r->whole)
        code = give_cell(r, thread, j, st);
    free_cell(j);
    pthread_mutex_lock(&r->lock);
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
    }
    return r->st->code;
}

static mn_code grow_cells(rounds *r, uint32_t made) {
    if ((uint64_t)made * SLOW_PART > r->vertices)
        return MN_OK;
    if (r->cell_vertices < r->cell_vertices_max / 2)
        r->cell_vertices *= 2;
    else if (r->cell_vertices < r->cell_vertices_max)
        r->cell_vertices = r->cell_vertices_max;
    else if (made == 0)
        return mn_fail(r->st, MN_CAP_TOO_SMALL,
                       "%u vertices cannot be simplified in cells of %u; try twice the --ram",
                       r->vertices, r->cell_vertices);
    return MN_OK;
}

static mn_code open_deal(rounds *r) {
    uint64_t work = r->sort_bytes == 0 ? (uint64_t)64 << 20 : r->sort_bytes / 2;
    mni_deal_desc desc = {.cells = r->cells,
                          .work_bytes = work > MNI_DEAL_WORK_MIN ? work : MNI_DEAL_WORK_MIN,
                          .temp_dir = r->desc.temp_dir};
    mn_code code = mni_deal_open(&r->deal, r->mesh, &desc, r->st);
    if (code == MN_OK)
        mni_deal_box(r->deal, r->low, r->high);
    return code;
}

static mn_code all_rounds(rounds *r) {
    mn_code code = MN_OK;
    for (r->round = 0; code == MN_OK && !r->whole; r->round++) {
        uint32_t before = r->history->collapses;
        r->cells = (uint32_t)(((uint64_t)r->vertices + r->cell_vertices - 1) / r->cell_vertices);
        r->whole = r->cells == 1;
        if (r->round == 0)
            code = open_deal(r);
        r->next_curve = mni_curve_make(r->low, r->high, r->round + 1);
        if (code == MN_OK)
            code = open_next(r);
        if (code == MN_OK)
            code = run_round(r);
        if (code == MN_OK)
            code = grow_cells(r, r->history->collapses - before);
        if (code == MN_OK)
            code = turn_over(r);
    }
    r->history->counts.rounds = r->round;
    return code;
}

/* Of a cell's vertex, with all that a run takes, and what the allocator keeps. */
enum { CELL_BYTES = 2000, SORT_BYTES_MIN = 2 << 20 };

static uint64_t cells_bytes(uint64_t vertices, uint64_t threads) {
    return vertices * threads * CELL_BYTES;
}

uint64_t mni_rounds_work_min(uint32_t cell_vertices) {
    return cells_bytes(cell_vertices > 0 ? cell_vertices : MNI_CELL_VERTICES, 1) + SORT_BYTES_MIN;
}

/* Half of the memory for cells at most; threads only where there is room for their cells. */
static void plan_memory(rounds *r) {
    mni_rounds_desc *d = &r->desc;
    uint64_t n = r->vertices, work = d->work_bytes;
    d->threads = d->threads == 0 ? 1 : d->threads < THREADS_MAX ? d->threads : THREADS_MAX;
    r->cell_vertices = d->cell_vertices > 0 ? d->cell_vertices : MNI_CELL_VERTICES;
    r->cell_vertices_max = UINT32_MAX / 2;
    if (work == 0)
        return;
    while (d->threads > 1 && cells_bytes(r->cell_vertices, d->threads) > work / 2)
        d->threads--;
    uint64_t one = cells_bytes(1, d->threads);
    r->cell_vertices_max = (uint32_t)(work / 2 / one < n ? work / 2 / one : n);
    uint64_t cells =
        one * (r->cell_vertices > r->cell_vertices_max ? r->cell_vertices : r->cell_vertices_max);
    r->sort_bytes = work > cells ? work - cells : 1;
}

mn_code mni_rounds(mni_extmesh *mesh, const mni_rounds_desc *desc, mni_history *out,
                   mn_status *st) {
    rounds r = {.mesh = mesh,
                .desc = *desc,
                .st = st,
                .history = out,
                .vertices = (uint32_t)mesh->vertices,
                .lock = PTHREAD_MUTEX_INITIALIZER,
                .turn = PTHREAD_COND_INITIALIZER};
    uint64_t read_before = mesh->vertex.bytes_read + mesh->triangle.bytes_read;
    MN_ASSERT(mesh->vertices > 1 && mesh->vertices < MNI_COLLAPSE);
    plan_memory(&r);
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
