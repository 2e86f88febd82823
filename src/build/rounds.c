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
 * A vertex is at the border when a neighbour's key is not inside the cell's. Threads take cells in
 * turn, work on them side by side, and give them back in turn. */
#include "rounds.h"

#include <malloc.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "curve.h"
#include "extsort.h"
#include "history.h"

static const double SHARE = 0.75; /* of what a cell could do, done in a round */
/* A round that makes fewer collapses than this part of its vertices is followed by one of cells
 * twice as large: costs that rise evenly over a whole region are put off from its edge inwards. */
enum { SLOW_PART = 8 };

enum { THREADS_MAX = 64 };

/* ---- streams ---- */

/* Where a vertex is: key, then id, which tells vertices in one place apart. */
typedef struct head {
    uint64_t key, id;
} head;

static int by_head(const head *x, const head *y) {
    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return x->id < y->id ? -1 : x->id > y->id;
}

/* ---- what travels ---- */

typedef struct vertex_record {
    head at;
    uint64_t low, high; /* keys of its neighbours, as far as its last cell saw them */
    mni_cell_vertex v;
} vertex_record;
_Static_assert(sizeof(vertex_record) <= MNI_SORT_RECORD_MAX, "a vertex can be sorted");

typedef struct simplex_record {
    head at; /* its first corner */
    mni_cell_simplex x;
} simplex_record;

typedef struct sight {
    head at; /* a vertex */
    uint64_t low, high;
} sight;

/* Where a triangle of the input is needed. */
typedef struct share_record {
    uint64_t cell_triangle; /* the cell's number in the upper half */
} share_record;

/* A sort, and the record that comes next, where any of them may stand. */
typedef struct stream {
    mni_sort *sort;
    uint32_t bytes;   /* of a record */
    const void *next; /* NULL: that was all */
    union {
        vertex_record vertex;
        simplex_record simplex;
        sight sight;
        share_record share;
    } record;
} stream;

enum { VERTICES, SIMPLICES, SIGHTS, STREAMS };
static const uint32_t record_bytes[STREAMS] = {sizeof(vertex_record), sizeof(simplex_record),
                                               sizeof(sight)};
/* Of the memory for sorting, what each may have. While a round goes on there are two of each. */
static const double stream_share[STREAMS] = {0.28, 0.2, 0.02};

typedef struct rounds {
    const mn_mesh *mesh;
    mni_rounds_desc desc;
    mn_status *st;
    stream now[STREAMS];
    mni_sort *next[STREAMS];
    mni_curve curve, next_curve;
    float low[3], high[3];
    uint32_t round;
    bool whole;          /* the last one */
    uint64_t sort_bytes; /* memory for sorting; 0: no bound */
    uint32_t cell_vertices, cell_vertices_max;
    uint32_t vertices, cells, taken, given; /* of this round; cells taken and given back */
    uint32_t *vertex_of;                    /* id → the mesh's vertex */
    uint32_t *id_of;
    mni_history history;
    pthread_mutex_t lock;
    pthread_cond_t turn;
    mn_code code;
} rounds;

/* For so many records, if memory has room for all of them; otherwise for a share of it. */
static mni_sort_desc sort_desc(const rounds *r, uint32_t bytes, double share, uint64_t records) {
    uint64_t all = 2 * (records + 64) * bytes + 2 * MNI_SORT_BUDGET_MIN;
    uint64_t budget = r->sort_bytes == 0 ? all : (uint64_t)(share * (double)r->sort_bytes);
    budget = budget < all ? budget : all;
    return (mni_sort_desc){.record_bytes = bytes,
                           .key = bytes == sizeof(share_record) ? MNI_SORT_U64 : MNI_SORT_U128,
                           .budget_bytes =
                               budget > MNI_SORT_BUDGET_MIN ? budget : MNI_SORT_BUDGET_MIN,
                           .temp_dir = r->desc.temp_dir};
}

static void advance(rounds *r, int which) {
    stream *s = &r->now[which];
    const void *next = mni_sort_next(s->sort, r->st);
    s->next = next != NULL ? memcpy(&s->record, next, s->bytes) : NULL;
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
        at[c] = (head){mni_curve_key(curve, x->p[c]), x->v[c]};
        if (by_head(&at[c], &at[first]) < 0)
            first = c;
    }
    return first;
}

static void send_simplex(rounds *r, const mni_cell_simplex *x) {
    head at[3];
    int first = first_corner(&r->next_curve, x, at);
    simplex_record record = {.at = at[first], .x = *x};
    mni_sort_put(r->next[SIMPLICES], &record);
}

/* Of a simplex between cells, of which no cell knows all corners: each is told of the others. */
static void send_sights(rounds *r, const mni_cell_simplex *x) {
    head at[3];
    uint64_t low = UINT64_MAX, high = 0;
    first_corner(&r->next_curve, x, at);
    for (int c = 0; c < corners_of(x); c++) {
        low = min_key(low, at[c].key);
        high = max_key(high, at[c].key);
    }
    for (int c = 0; c < corners_of(x); c++) {
        sight s = {at[c], low, high};
        mni_sort_put(r->next[SIGHTS], &s);
    }
}

/* ---- where a vertex stands ---- */

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

/* ---- filling a cell ---- */

/* A cell, and the simplices that it has seen and that go on to the next round as they are. */
typedef struct job {
    mni_cell cell;
    mni_cell passing; /* simplices alone */
} job;

static uint32_t cell_start(const rounds *r, uint32_t c) {
    return (uint32_t)((uint64_t)r->vertices * c / r->cells);
}

static mn_code add_simplex(mni_cell *cell, const mni_cell_simplex *x, mn_status *st) {
    if (cell->simplices == cell->simplices_room) {
        uint32_t room = cell->simplices_room * 2 + 1024;
        mni_cell_simplex *more = realloc(cell->simplex, room * sizeof *more);
        if (more == NULL)
            return mn_fail(st, MN_FAILED, "out of memory for %u simplices", room);
        cell->simplex = more;
        cell->simplices_room = room;
    }
    cell->simplex[cell->simplices++] = *x;
    return MN_OK;
}

static mn_code fill_vertices(rounds *r, uint32_t c, mni_cell *cell, head *last) {
    uint32_t count = cell_start(r, c + 1) - cell_start(r, c);
    uint64_t(*seen)[2] = malloc(count * sizeof *seen), first = 0;
    cell->vertex = malloc(count * sizeof *cell->vertex);
    if (cell->vertex == NULL || seen == NULL) {
        free(seen);
        return mn_fail(r->st, MN_FAILED, "out of memory for a cell of %u vertices", count);
    }
    cell->vertices = count;
    for (uint32_t v = 0; v < count; v++) {
        const vertex_record *record = r->now[VERTICES].next;
        const sight *s;
        if (record == NULL) { /* the stream has failed: as many are there as were counted */
            free(seen);
            return r->st->code;
        }
        cell->vertex[v] = record->v;
        seen[v][0] = record->low;
        seen[v][1] = record->high;
        *last = record->at;
        first = v == 0 ? record->at.key : first;
        advance(r, VERTICES);
        while ((s = r->now[SIGHTS].next) != NULL && by_head(&s->at, last) == 0) {
            seen[v][0] = min_key(seen[v][0], s->low);
            seen[v][1] = max_key(seen[v][1], s->high);
            advance(r, SIGHTS);
        }
    }
    for (uint32_t v = 0; v < count; v++) /* equal keys may be in the next cell */
        cell->vertex[v].border = !r->whole && (seen[v][0] <= first || seen[v][1] >= last->key);
    free(seen);
    return MN_OK;
}

/* Hinges stand behind triangles. */
static mn_code hinges_last(mni_cell *cell, mn_status *st) {
    mni_cell hinges = {0};
    uint32_t kept = 0;
    mn_code code = MN_OK;
    for (uint32_t x = 0; x < cell->simplices && code == MN_OK; x++)
        if (cell->simplex[x].v[2] == MN_NONE)
            code = add_simplex(&hinges, &cell->simplex[x], st);
        else
            cell->simplex[kept++] = cell->simplex[x];
    if (hinges.simplices > 0)
        memcpy(&cell->simplex[kept], hinges.simplex, hinges.simplices * sizeof *hinges.simplex);
    free(hinges.simplex);
    return code;
}

static mn_code fill_cell(rounds *r, uint32_t c, job *j) {
    head last = {0};
    places p = {0};
    const simplex_record *record;
    mni_cell *cell = &j->cell;
    mn_code code = fill_vertices(r, c, cell, &last);
    if (code == MN_OK && !places_open(&p, cell->vertices))
        code = mn_fail(r->st, MN_FAILED, "out of memory for a cell");
    for (uint32_t v = 0; v < cell->vertices && code == MN_OK; v++)
        place(&p, cell, v);
    while (code == MN_OK && (record = r->now[SIMPLICES].next) != NULL &&
           by_head(&record->at, &last) <= 0) {
        mni_cell_simplex x = record->x;
        bool inside = true;
        for (int i = 0; i < 3; i++) {
            x.at[i] = x.v[i] == MN_NONE ? MN_NONE : place_of(&p, cell, x.v[i]);
            inside &= x.v[i] == MN_NONE || x.at[i] != MN_NONE;
        }
        code = add_simplex(inside ? cell : &j->passing, &x, r->st);
        advance(r, SIMPLICES);
    }
    free(p.at);
    if (code == MN_OK)
        code = r->st->code; /* of a stream */
    return code == MN_OK ? hinges_last(cell, r->st) : code;
}

/* ---- the first round ---- */

static uint32_t cell_of(const rounds *r, uint32_t id) {
    uint32_t c = (uint32_t)(((uint64_t)id * r->cells) / r->vertices);
    while (cell_start(r, c + 1) <= id)
        c++;
    while (cell_start(r, c) > id)
        c--;
    return c;
}

static mn_code take_triangles(rounds *r, uint32_t c, mni_cell *cell) {
    const share_record *record;
    mn_code code = MN_OK;
    while (code == MN_OK && (record = r->now[SIMPLICES].next) != NULL &&
           record->cell_triangle >> 32 == c) {
        mni_cell_simplex x = {.id = (uint32_t)record->cell_triangle};
        for (int i = 0; i < 3; i++)
            x.v[i] = x.origin[i] = r->id_of[r->mesh->corner[3 * (size_t)x.id + i]];
        code = add_simplex(cell, &x, r->st);
        advance(r, SIMPLICES);
    }
    return code == MN_OK ? r->st->code : code; /* of the stream */
}

static bool room_for_vertex(mni_cell *cell, uint32_t *room) {
    if (cell->vertices < *room)
        return true;
    *room += *room / 4 + 64;
    mni_cell_vertex *more = realloc(cell->vertex, *room * sizeof *more);
    if (more != NULL)
        cell->vertex = more;
    return more != NULL;
}

/* Where an id stands: the cell's own vertices first, then ghosts, as its triangles bring them
 * along. MN_NONE: no memory. */
static uint32_t stand(mni_cell *cell, places *p, uint32_t *room, uint32_t start, uint32_t own,
                      uint32_t id) {
    if (id - start < own)
        return id - start;
    uint32_t at = place_of(p, cell, id);
    if (at != MN_NONE)
        return at;
    if (!room_for_vertex(cell, room))
        return MN_NONE;
    cell->vertex[cell->vertices] = (mni_cell_vertex){.id = id, .ghost = true};
    place(p, cell, cell->vertices);
    return cell->vertices++;
}

static mn_code fill_first_cell(rounds *r, uint32_t c, job *j) {
    mni_cell *cell = &j->cell;
    uint32_t start = cell_start(r, c), own = cell_start(r, c + 1) - start, room = own;
    places p = {0};
    mn_code code = take_triangles(r, c, cell);
    if (code != MN_OK)
        return code;
    cell->vertex = malloc((size_t)own * sizeof *cell->vertex);
    bool good = cell->vertex != NULL && places_open(&p, 3 * cell->simplices);
    for (; good && cell->vertices < own; cell->vertices++)
        cell->vertex[cell->vertices] = (mni_cell_vertex){.id = start + cell->vertices};
    for (uint32_t x = 0; x < cell->simplices && good; x++) {
        mni_cell_simplex *s = &cell->simplex[x];
        bool crosses = false;
        for (int i = 0; i < 3 && good; i++) {
            s->at[i] = stand(cell, &p, &room, start, own, s->v[i]);
            good = s->at[i] != MN_NONE;
            crosses |= s->at[i] >= own;
        }
        for (int i = 0; i < 3 && good; i++)
            cell->vertex[s->at[i]].border |= crosses;
    }
    free(p.at);
    if (!good)
        return mn_fail(r->st, MN_FAILED, "out of memory for a cell of %u vertices", own);
    for (uint32_t v = 0; v < cell->vertices; v++) {
        mni_cell_vertex *to = &cell->vertex[v];
        to->node = to->id;
        memcpy(to->p, &r->mesh->position[3 * (size_t)r->vertex_of[to->id]], sizeof to->p);
    }
    return MN_OK;
}

/* Ids are places on the first curve. */
static mn_code number_vertices(rounds *r) {
    const mn_mesh *m = r->mesh;
    const void *next;
    mni_sort *order;
    mni_sort_desc desc = sort_desc(r, sizeof(head), 0.5, m->vertices);
    mn_code code = mni_sort_open(&order, &desc, r->st);
    for (uint32_t v = 0; v < m->vertices && code == MN_OK; v++) {
        head at = {mni_curve_key(&r->curve, &m->position[3 * (size_t)v]), v};
        mni_sort_put(order, &at);
    }
    if (code == MN_OK)
        code = mni_sort_finish(order, r->st);
    for (uint32_t id = 0; code == MN_OK && (next = mni_sort_next(order, r->st)) != NULL; id++) {
        head at;
        memcpy(&at, next, sizeof at);
        r->vertex_of[id] = (uint32_t)at.id;
        r->id_of[at.id] = id;
    }
    mni_sort_close(order);
    return code == MN_OK ? r->st->code : code;
}

/* Each cell gets the triangles at its vertices. */
static mn_code deal_triangles(rounds *r) {
    const mn_mesh *m = r->mesh;
    mni_sort_desc desc =
        sort_desc(r, sizeof(share_record), 0.4, m->triangles + (uint64_t)m->triangles / 4);
    mn_code code = mni_sort_open(&r->now[SIMPLICES].sort, &desc, r->st);
    r->now[SIMPLICES].bytes = sizeof(share_record);
    for (uint32_t t = 0; t < m->triangles && code == MN_OK; t++) {
        uint32_t cell[3];
        for (int i = 0; i < 3; i++)
            cell[i] = cell_of(r, r->id_of[m->corner[3 * (size_t)t + i]]);
        for (int i = 0; i < 3; i++)
            if ((i < 1 || cell[i] != cell[0]) && (i < 2 || cell[i] != cell[1])) {
                share_record record = {(uint64_t)cell[i] << 32 | t};
                mni_sort_put(r->now[SIMPLICES].sort, &record);
            }
    }
    if (code == MN_OK)
        code = mni_sort_finish(r->now[SIMPLICES].sort, r->st);
    if (code == MN_OK)
        advance(r, SIMPLICES);
    return code;
}

static mn_code open_first(rounds *r) {
    size_t bytes = r->mesh->vertices * sizeof *r->vertex_of;
    r->vertex_of = malloc(bytes);
    r->id_of = malloc(bytes);
    if (r->vertex_of == NULL || r->id_of == NULL)
        return mn_fail(r->st, MN_FAILED, "out of memory for %u vertices", r->mesh->vertices);
    mn_code code = number_vertices(r);
    return code == MN_OK ? deal_triangles(r) : code;
}

/* ---- giving a cell back ---- */

static mn_code give_cell(rounds *r, job *j, mn_status *st) {
    mni_cell *cell = &j->cell;
    mni_cell_number(cell, r->history.collapses, r->history.hinges);
    mn_code code = mni_history_add(&r->history, cell, st);
    if (code != MN_OK)
        return code;
    vertex_record *record = malloc(((size_t)cell->vertices + 1) * sizeof *record);
    if (record == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for a cell");
    for (uint32_t v = 0; v < cell->vertices; v++)
        record[v] = (vertex_record){
            .at = {mni_curve_key(&r->next_curve, cell->vertex[v].p), cell->vertex[v].id},
            .low = UINT64_MAX,
            .v = cell->vertex[v]};
    for (uint32_t x = 0; x < cell->simplices; x++) {
        const mni_cell_simplex *s = &cell->simplex[x];
        uint64_t low = UINT64_MAX, high = 0;
        simplex_record to = {.x = *s};
        bool crosses = false;
        for (int c = 0; c < corners_of(s); c++) {
            head at = s->at[c] != MN_NONE ? record[s->at[c]].at
                                          : (head){mni_curve_key(&r->next_curve, s->p[c]), s->v[c]};
            crosses |= s->at[c] == MN_NONE;
            low = min_key(low, at.key);
            high = max_key(high, at.key);
            if (c == 0 || by_head(&at, &to.at) < 0)
                to.at = at;
        }
        mni_sort_put(r->next[SIMPLICES], &to);
        if (crosses)
            send_sights(r, s);
        for (int c = 0; c < corners_of(s); c++)
            if (s->at[c] != MN_NONE) {
                record[s->at[c]].low = min_key(record[s->at[c]].low, low);
                record[s->at[c]].high = max_key(record[s->at[c]].high, high);
            }
    }
    for (uint32_t v = 0; v < cell->vertices; v++)
        mni_sort_put(r->next[VERTICES], &record[v]);
    for (uint32_t x = 0; x < j->passing.simplices; x++) {
        send_simplex(r, &j->passing.simplex[x]);
        send_sights(r, &j->passing.simplex[x]);
    }
    free(record);
    return MN_OK;
}

static void free_job(job *j) {
    free(j->cell.vertex);
    free(j->cell.simplex);
    free(j->cell.collapse);
    free(j->cell.killed);
    free(j->passing.simplex);
    *j = (job){0};
}

/* ---- rounds ---- */

/* Filling and giving back are under the lock, one cell after the other; the work is not. */
static mn_code take_cell(rounds *r, job *j, mn_status *st) {
    uint32_t c = r->taken++;
    mni_cell_desc desc = {.metric = r->desc.metric,
                          .first = r->round == 0,
                          .whole = r->whole,
                          .stage = 1,
                          .share = SHARE};
    mn_code code = r->round == 0 ? fill_first_cell(r, c, j) : fill_cell(r, c, j);
    if (code != MN_OK)
        *st = *r->st;
    pthread_mutex_unlock(&r->lock);
    if (code == MN_OK)
        code = mni_cell_run(&j->cell, &desc, st);
    pthread_mutex_lock(&r->lock);
    while (r->given != c)
        pthread_cond_wait(&r->turn, &r->lock);
    r->given++;
    pthread_cond_broadcast(&r->turn);
    return code;
}

static mn_code tell(const rounds *r, mn_status *st) {
    if (r->desc.progress == NULL || r->desc.progress(r->desc.progress_context, "simplify",
                                                     r->history.collapses, r->mesh->vertices))
        return MN_OK;
    return mn_fail(st, MN_FAILED, "interrupted");
}

static void *worker(void *context) {
    rounds *r = context;
    job j = {0};
    pthread_mutex_lock(&r->lock);
    while (r->taken < r->cells && r->code == MN_OK) {
        mn_status st = {0};
        mn_code code = take_cell(r, &j, &st);
        if (code == MN_OK && r->code == MN_OK)
            code = give_cell(r, &j, &st);
        if (code == MN_OK)
            code = tell(r, &st);
        if (code != MN_OK && r->code == MN_OK) {
            r->code = code;
            *r->st = st;
        }
        free_job(&j);
    }
    pthread_mutex_unlock(&r->lock);
    return NULL;
}

/* A round can hardly have more hinges, or simplices between cells, than the room that is left for
 * them here; if it has, they are sorted on disk. */
static mn_code open_next(rounds *r) {
    const uint64_t most[STREAMS] = {r->vertices, 2 * (uint64_t)r->vertices + r->vertices / 4,
                                    r->vertices / 2};
    mn_code code = MN_OK;
    for (int i = 0; i < STREAMS && code == MN_OK; i++) {
        mni_sort_desc desc = sort_desc(r, record_bytes[i], stream_share[i], most[i]);
        code = mni_sort_open(&r->next[i], &desc, r->st);
    }
    return code;
}

static mn_code run_round(rounds *r) {
    pthread_t thread[THREADS_MAX];
    uint32_t started = 0;
    mn_code code = open_next(r);
    if (code != MN_OK)
        return code;
    r->taken = r->given = 0;
    while (started + 1 < r->desc.threads && started < THREADS_MAX &&
           pthread_create(&thread[started], NULL, worker, r) == 0)
        started++;
    worker(r);
    while (started > 0)
        pthread_join(thread[--started], NULL);
    return r->code;
}

/* What was written is what is read next. */
static mn_code turn_over(rounds *r) {
    mn_code code = MN_OK;
    for (int i = 0; i < STREAMS && code == MN_OK; i++) {
        mni_sort_close(r->now[i].sort);
        r->now[i] = (stream){.sort = r->next[i], .bytes = record_bytes[i]};
        r->next[i] = NULL;
        code = mni_sort_finish(r->now[i].sort, r->st);
        if (code == MN_OK)
            advance(r, i);
    }
    r->vertices = (uint32_t)mni_sort_figures_get(r->now[VERTICES].sort).records;
    return code == MN_OK ? r->st->code : code;
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

static mn_code all_rounds(rounds *r) {
    mn_code code = mni_history_open(&r->history, r->desc.temp_dir, r->st);
    for (r->round = 0; code == MN_OK && !r->whole; r->round++) {
        uint32_t before = r->history.collapses;
        r->curve = mni_curve_make(r->low, r->high, r->round);
        r->next_curve = mni_curve_make(r->low, r->high, r->round + 1);
        r->cells = (uint32_t)(((uint64_t)r->vertices + r->cell_vertices - 1) / r->cell_vertices);
        r->whole = r->cells == 1;
        if (r->round == 0)
            code = open_first(r);
        if (code == MN_OK)
            code = run_round(r);
        if (code == MN_OK)
            code = grow_cells(r, r->history.collapses - before);
        if (code == MN_OK)
            code = turn_over(r);
    }
    r->history.counts.rounds = r->round;
    if (code == MN_OK) {
        const mni_cell_vertex *root = &((const vertex_record *)r->now[VERTICES].next)->v;
        r->history.root_value = root->value;
        r->history.root_levels = root->levels;
    }
    return code;
}

static void close_rounds(rounds *r) {
    for (int i = 0; i < STREAMS; i++) {
        mni_sort_close(r->now[i].sort);
        mni_sort_close(r->next[i]);
    }
    mni_history_close(&r->history);
    free(r->vertex_of);
    free(r->id_of);
}

/* Of a cell's vertex, with all that a run takes, and what the allocator keeps. */
enum { CELL_BYTES = 2000 };

static uint64_t mesh_bytes(uint64_t vertices, uint64_t triangles) {
    return vertices * (12 + 4 /* colour */) + triangles * 12;
}

/* While the tree is made; sorting takes what the tree will need. */
static uint64_t tree_bytes(uint64_t vertices, uint64_t triangles) {
    return vertices * (12 + 4 + 4 * 5 + 8 + 3 + 4 /* tree */ + 20 /* history.c */ + 4 /* ids */) +
           triangles * 12;
}

static uint64_t cells_bytes(uint64_t vertices, uint64_t threads) {
    return vertices * threads * CELL_BYTES;
}

uint64_t mni_rounds_need_bytes(uint64_t vertices, uint64_t triangles) {
    enum { SORT_BYTES_MIN = 2 << 20 };
    uint64_t sorting = vertices * 8 + cells_bytes(MNI_CELL_VERTICES, 1) + SORT_BYTES_MIN;
    uint64_t growing = tree_bytes(vertices, triangles);
    return MNI_PROGRAM_BYTES + mesh_bytes(vertices, triangles) +
           (growing > sorting ? growing : sorting);
}

/* Half of what is free for cells at most; threads only where there is room for their cells. */
static void plan_memory(rounds *r) {
    const mni_rounds_desc *d = &r->desc;
    uint64_t n = r->vertices;
    r->cell_vertices = d->cell_vertices > 0 ? d->cell_vertices : MNI_CELL_VERTICES;
    r->cell_vertices_max = UINT32_MAX / 2;
    if (d->ram_bytes == 0)
        return;
    uint64_t taken = MNI_PROGRAM_BYTES + mesh_bytes(n, r->mesh->triangles) + 8 * n;
    uint64_t left = d->ram_bytes > taken ? d->ram_bytes - taken : 1;
    while (r->desc.threads > 1 && cells_bytes(r->cell_vertices, r->desc.threads) > left / 2)
        r->desc.threads--;
    uint64_t one = cells_bytes(1, r->desc.threads > 0 ? r->desc.threads : 1);
    r->cell_vertices_max = (uint32_t)(left / 2 / one < n ? left / 2 / one : n);
    uint64_t cells =
        one * (r->cell_vertices > r->cell_vertices_max ? r->cell_vertices : r->cell_vertices_max);
    r->sort_bytes = left > cells ? left - cells : 1;
}

static void find_box(rounds *r) {
    for (int i = 0; i < 3; i++) {
        r->low[i] = INFINITY;
        r->high[i] = -INFINITY;
    }
    for (size_t i = 0; i < 3 * (size_t)r->mesh->vertices; i++) {
        r->low[i % 3] = fminf(r->low[i % 3], r->mesh->position[i]);
        r->high[i % 3] = fmaxf(r->high[i % 3], r->mesh->position[i]);
    }
}

mn_code mni_rounds(const mn_mesh *mesh, const mni_rounds_desc *desc, mn_tree *out, mn_status *st) {
    rounds r = {.mesh = mesh,
                .desc = *desc,
                .st = st,
                .vertices = mesh->vertices,
                .lock = PTHREAD_MUTEX_INITIALIZER,
                .turn = PTHREAD_COND_INITIALIZER};
    plan_memory(&r);
    find_box(&r);
    mn_code code = all_rounds(&r);
    for (int i = 0; i < STREAMS; i++) { /* the tree needs the room */
        mni_sort_close(r.now[i].sort);
        r.now[i].sort = NULL;
    }
    free(r.id_of);
    r.id_of = NULL;
    malloc_trim(0);
    if (code == MN_OK)
        code = mni_history_tree(&r.history, mesh, r.vertex_of, out, st);
    if (code == MN_OK)
        out->metric = desc->metric;
    close_rounds(&r);
    return code;
}
