/* See aside.h. Hidden here: who went into whom, as a table that is climbed. */
#include "aside.h"

#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "extsort.h"

enum { BUFFER_BYTES = 64 << 10, POLL_EVERY = 1 << 14, RECENT = 1 << 14 };
enum { STEP_BYTES = 28, LEAST_BYTES = 1 << 20 };

/* A collapse that was made when all was aside. */
typedef struct late {
    mni_cell_collapse collapse;
    uint32_t removed, kept; /* ids of vertices */
} late;

/* A vertex that went into another. */
typedef struct step {
    uint32_t id, kept, number; /* kept: first an id, then a place in the table; MN_NONE: the root */
} step;

/* A simplex that died: by number of the late collapse. */
typedef struct death {
    uint32_t number, origin[3];
} death;

/* Somebody died there with this vertex for its third corner. */
typedef struct recent {
    uint32_t number, apex;
} recent;

typedef struct finisher {
    mni_aside *aside;
    mni_history *history;
    step *step; /* by id */
    uint32_t steps;
    uint32_t *group; /* which vertices are joined: those of the table, and the root behind them */
    uint32_t joins;
    recent *recent;
    mni_sort *deaths;
    const mni_poll *poll;
    mn_status *st;
} finisher;

/* ---- putting -------------------------------------------------------------------------------- */

mn_code mni_aside_open(mni_aside *a, const char *temp_dir, mn_status *st) {
    *a = MNI_ASIDE_CLOSED;
    a->buffer = malloc(2 * BUFFER_BYTES);
    if (a->buffer == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for a temporary file");
    mn_code code = mni_spill_open(&a->simplex, temp_dir, st);
    if (code == MN_OK)
        code = mni_spill_open(&a->late, temp_dir, st);
    mni_spill_writer_open(&a->put_simplex, &a->simplex, a->buffer, BUFFER_BYTES);
    mni_spill_writer_open(&a->put_late, &a->late, a->buffer + BUFFER_BYTES, BUFFER_BYTES);
    return code;
}

void mni_aside_close(mni_aside *a) {
    mni_spill_close(&a->simplex);
    mni_spill_close(&a->late);
    free(a->buffer);
    *a = MNI_ASIDE_CLOSED;
}

static mn_code trouble_of(const mni_spill *spill, mn_status *st) {
    if (spill->trouble.code != MN_OK)
        mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
    return spill->trouble.code;
}

mn_code mni_aside_put(mni_aside *a, const mni_parcel *head, const unsigned char *simplices,
                      float grid, mn_status *st) {
    mni_wire_pen pen = mni_wire_pen_open(head->tile, grid);
    for (uint32_t i = 0; i < head->simplices; i++) {
        mni_wire_simplex x;
        mni_aside_simplex to;
        mni_wire_get_simplex(&pen, &simplices, &x);
        memcpy(to.v, x.v, sizeof to.v);
        memcpy(to.origin, x.origin, sizeof to.origin);
        mni_spill_put(&a->put_simplex, &to, sizeof to);
    }
    a->count += head->simplices;
    return trouble_of(&a->simplex, st);
}

mn_code mni_aside_add(mni_aside *a, const mni_cell *cell, mn_status *st) {
    mni_spill_put(&a->put_simplex, cell->aside, cell->aside_count * sizeof *cell->aside);
    a->count += cell->aside_count;
    return trouble_of(&a->simplex, st);
}

mn_code mni_aside_late(mni_aside *a, const mni_cell *cell, mn_status *st) {
    const mni_collapses *made = &cell->s.made;
    uint32_t *kept = malloc(((size_t)cell->collapses + 1) * sizeof *kept); /* vertices here */
    if (kept == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for %u collapses", cell->collapses);
    for (uint32_t i = 0; i < cell->collapses; i++) {
        uint32_t left = made->left[i], right = made->right[i];
        kept[i] = left < cell->vertices ? left : kept[left - cell->vertices];
        uint32_t removed = right < cell->vertices ? right : kept[right - cell->vertices];
        const late l = {cell->collapse[i], cell->node[removed].id, cell->node[kept[i]].id};
        mni_spill_put(&a->put_late, &l, sizeof l);
    }
    a->late_count += cell->collapses;
    free(kept);
    return trouble_of(&a->late, st);
}

/* ---- who went into whom ---------------------------------------------------------------------- */

static int by_id(const void *a, const void *b) {
    uint32_t x = ((const step *)a)->id, y = ((const step *)b)->id;
    return x < y ? -1 : x > y;
}

static uint32_t find(const finisher *f, uint32_t id) {
    uint32_t low = 0, high = f->steps;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (f->step[middle].id < id)
            low = middle + 1;
        else
            high = middle;
    }
    return low < f->steps && f->step[low].id == id ? low : MN_NONE;
}

static mn_code load_steps(finisher *f, void *buffer) {
    mni_spill_reader from;
    const late *l;
    mni_spill *spill = &f->aside->late;
    mni_spill_reader_open(&from, spill, 0, spill->size_bytes, buffer,
                          BUFFER_BYTES / sizeof *l * sizeof *l, false);
    for (uint32_t i = 0; (l = mni_spill_take(&from, sizeof *l)) != NULL; i++)
        f->step[i] = (step){l->removed, l->kept, i};
    qsort(f->step, f->steps, sizeof *f->step, by_id);
    for (uint32_t i = 0; i < f->steps; i++)
        f->step[i].kept = find(f, f->step[i].kept);
    for (uint32_t i = 0; i <= f->steps; i++)
        f->group[i] = i;
    return trouble_of(spill, f->st);
}

static uint32_t group_of(finisher *f, uint32_t at) {
    at = at == MN_NONE ? f->steps : at;
    while (f->group[at] != at)
        at = f->group[at] = f->group[f->group[at]];
    return at;
}

static void join(finisher *f, uint32_t a, uint32_t b) {
    uint32_t x = group_of(f, a), y = group_of(f, b);
    f->group[x] = y;
    f->joins += x != y;
}

static uint32_t number_of(const finisher *f, uint32_t at) {
    return at == MN_NONE ? MN_NONE : f->step[at].number;
}

/* ---- where simplices die ----------------------------------------------------------------------
 */

/* Climbs until two of the corners meet. Returns the collapse; *gone went into *met. */
static uint32_t climb(const finisher *f, uint32_t at[], int corners, int *gone, int *met) {
    for (;;) {
        int least = 0;
        for (int c = 1; c < corners; c++)
            if (number_of(f, at[c]) < number_of(f, at[least]))
                least = c;
        MN_ASSERT(at[least] != MN_NONE);
        uint32_t number = f->step[at[least]].number;
        at[least] = f->step[at[least]].kept;
        for (int c = 0; c < corners; c++)
            if (c != least && at[c] == at[least]) {
                *gone = least;
                *met = c;
                return number;
            }
    }
}

static void know_none(finisher *f) {
    for (uint32_t i = 0; i < RECENT; i++)
        f->recent[i] = (recent){MN_NONE, MN_NONE};
}

/* Whether such a hinge has been made lately. */
static bool is_known(finisher *f, uint32_t number, uint32_t apex) {
    uint32_t hash = (number * 0x9e3779b1u) ^ (apex * 0x85ebca6bu);
    recent *r = &f->recent[(hash ^ hash >> 15) & (RECENT - 1)];
    bool known = r->number == number && r->apex == apex;
    *r = (recent){number, apex};
    return known;
}

static void bury(finisher *f, const mni_aside_simplex *x) {
    int corners = x->v[2] == MN_NONE ? 2 : 3, gone, met;
    uint32_t at[3];
    for (int c = 0; c < corners; c++)
        at[c] = find(f, x->v[c]);
    for (int c = 1; c < corners; c++)
        join(f, at[0], at[c]);
    death d = {.origin = {x->origin[0], x->origin[1], x->origin[2]}};
    d.number = climb(f, at, corners, &gone, &met);
    mni_sort_put(f->deaths, &d);
    f->history->killed_count++;
    int apex = 3 - gone - met;
    if (corners == 2 || is_known(f, d.number, x->v[apex]))
        return;
    uint32_t ends[2] = {at[met], at[apex]};
    d = (death){.origin = {x->origin[met], x->origin[apex], MN_NONE}};
    d.number = climb(f, ends, 2, &gone, &met);
    mni_sort_put(f->deaths, &d);
    f->history->killed_count++;
    f->history->hinges++;
}

static mn_code bury_all(finisher *f, void *buffer) {
    mni_spill_reader from;
    const mni_aside_simplex *x;
    mni_spill *spill = &f->aside->simplex;
    mni_spill_reader_open(&from, spill, 0, spill->size_bytes, buffer,
                          BUFFER_BYTES / sizeof *x * sizeof *x, true);
    for (uint64_t i = 0; (x = mni_spill_take(&from, sizeof *x)) != NULL; i++) {
        bury(f, x);
        if (i % POLL_EVERY == 0 && f->poll->go_on != NULL && !f->poll->go_on(f->poll->context))
            return mn_fail(f->st, MN_FAILED, "interrupted");
    }
    return trouble_of(spill, f->st);
}

/* ---- to the history -------------------------------------------------------------------------- */

static mn_code give_late(finisher *f, void *buffer) {
    mni_spill_reader from;
    const late *l;
    mni_spill *spill = &f->aside->late;
    mni_spill_reader_open(&from, spill, 0, spill->size_bytes, buffer,
                          BUFFER_BYTES / sizeof *l * sizeof *l, true);
    mn_code code = mni_sort_finish(f->deaths, f->st);
    const death *next = code == MN_OK ? mni_sort_next(f->deaths, f->st) : NULL;
    for (uint32_t i = 0; f->st->code == MN_OK && (l = mni_spill_take(&from, sizeof *l)) != NULL;
         i++) {
        mni_cell_collapse collapse = l->collapse;
        mni_history_begin(f->history);
        for (; next != NULL && next->number == i; next = mni_sort_next(f->deaths, f->st)) {
            mni_history_add_killed(f->history, next->origin);
            collapse.simplices++;
        }
        mni_history_add_collapse(f->history, &collapse);
        f->aside->late_count--;
        if (i % POLL_EVERY == 0 && f->poll->go_on != NULL && !f->poll->go_on(f->poll->context))
            return mn_fail(f->st, MN_FAILED, "interrupted");
    }
    MN_ASSERT(f->st->code != MN_OK || spill->trouble.code != MN_OK || next == NULL);
    return f->st->code == MN_OK ? trouble_of(spill, f->st) : f->st->code;
}

static mn_code run(finisher *f, uint64_t sort_bytes, const char *temp_dir) {
    const mni_sort_desc desc = {.record_bytes = sizeof(death),
                                .key = MNI_SORT_U32,
                                .budget_bytes = sort_bytes,
                                .temp_dir = temp_dir};
    void *buffer = f->aside->buffer;
    know_none(f);
    mn_code code = mni_sort_open(&f->deaths, &desc, f->st);
    if (code == MN_OK && mni_spill_end(&f->aside->put_simplex) != MN_OK)
        code = trouble_of(&f->aside->simplex, f->st);
    if (code == MN_OK && mni_spill_end(&f->aside->put_late) != MN_OK)
        code = trouble_of(&f->aside->late, f->st);
    if (code == MN_OK)
        code = load_steps(f, buffer);
    if (code == MN_OK)
        code = bury_all(f, buffer);
    if (code == MN_OK)
        code = give_late(f, buffer);
    f->history->counts.components += f->steps + 1 - f->joins;
    if (f->deaths != NULL) {
        mni_sort_figures g = mni_sort_figures_get(f->deaths);
        f->history->bytes_read += g.bytes_read;
        f->history->bytes_written += g.bytes_written;
    }
    mni_sort_close(f->deaths);
    const mni_spill *const spills[] = {&f->aside->simplex, &f->aside->late};
    for (int i = 0; i < 2; i++) {
        f->history->bytes_read += spills[i]->bytes_read;
        f->history->bytes_written += spills[i]->bytes_written;
    }
    return code;
}

uint64_t mni_aside_least(uint64_t collapses) {
    return LEAST_BYTES + collapses * STEP_BYTES + MNI_SORT_BUDGET_MIN;
}

mn_code mni_aside_finish(mni_aside *a, mni_history *history, uint64_t work_bytes,
                         const char *temp_dir, const mni_poll *poll, mn_status *st) {
    const uint64_t steps_bytes = LEAST_BYTES + (uint64_t)a->late_count * STEP_BYTES;
    const uint64_t all = 4 * sizeof(death) * (a->count + 1) + 2 * MNI_SORT_BUDGET_MIN;
    uint64_t sort_bytes = all;
    MN_ASSERT(work_bytes == 0 || work_bytes >= mni_aside_least(a->late_count));
    if (work_bytes > 0 && work_bytes - steps_bytes < all)
        sort_bytes = work_bytes - steps_bytes;
    finisher f = {.aside = a,
                  .history = history,
                  .steps = a->late_count,
                  .step = malloc(((size_t)a->late_count + 1) * sizeof *f.step),
                  .group = malloc(((size_t)a->late_count + 1) * sizeof *f.group),
                  .recent = malloc(RECENT * sizeof *f.recent),
                  .poll = poll,
                  .st = st};
    mn_code code = f.step != NULL && f.group != NULL && f.recent != NULL
                       ? run(&f, sort_bytes, temp_dir)
                       : mn_fail(st, MN_FAILED, "out of memory for %u vertices", a->late_count);
    free(f.step);
    free(f.group);
    free(f.recent);
    return code;
}
