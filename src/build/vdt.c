/* Trees that need not fit in memory: made of a mesh, or opened, then written or cut into blocks.
 *
 *   make   mesh ──► extmesh.h ──► rounds.h ──► order.h ──┐
 *   open   .vdt, summed up once ─────────────────────────┴──► rows in a file ──► write, block
 *
 * Hides: where the rows are, a file of ours without a name or somebody's .vdt; and what is kept of
 * each phase for a build that goes on after a kill (work.h).
 *
 * Memory: phases follow one another, and each has what the process may take less what the program
 * itself does: see work_bytes. One thread a tree (rounds start their own); calls block on the disk.
 * Paper: §3. */
#include <malloc.h>
#include <stdlib.h>
#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* the state's size */
#include <xxhash.h>

#include "block_rows.h"
#include "cap.h"
#include "clock.h"
#include "grid.h"
#include "mnt_spill.h"
#include "need_disk.h"
#include "order.h"
#include "reader.h"
#include "rounds.h"
#include "rowpack.h"
#include "tree.h"
#include "vdt_header.h"
#include "vdt_rows.h"
#include "watch.h"
#include "work.h"

enum {
    COPY_BYTES = 256 << 10,
    ROW_PACKED_MOST = 32, /* 22 to 28 were seen, and 1 of a .mnt's places */
    SIMPLEX_PACKED_MOST = 7,
};

struct mn_vdt {
    mn_tree head;
    bool has_colors;
    uint64_t sum[MNI_SECTIONS];
    mni_spill made; /* of a tree that was made, or was in a .mnt; -1: a .vdt */
    mni_in file;    /* of a .vdt; -1: made */
    char *path;     /* likewise */
    uint64_t stamp; /* likewise: before its bytes were summed up */
    mn_vdt_figures figures;
};

static mn_vdt *new_vdt(mn_status *st) {
    mn_vdt *vdt = calloc(1, sizeof *vdt);
    if (vdt == NULL)
        mn_fail(st, MN_FAILED, "no memory for a tree");
    else
        vdt->made.fd = vdt->file.fd = -1;
    return vdt;
}

void mn_vdt_close(mn_vdt *vdt) {
    if (vdt == NULL)
        return;
    mni_spill_close(&vdt->made);
    if (vdt->file.fd >= 0)
        mni_in_close(&vdt->file);
    free(vdt->path);
    free(vdt);
}

const mn_tree *mn_vdt_head(const mn_vdt *vdt) {
    return &vdt->head;
}

bool mn_vdt_has_colors(const mn_vdt *vdt) {
    return vdt->has_colors;
}

const mn_vdt_figures *mn_vdt_figures_of(const mn_vdt *vdt) {
    return &vdt->figures;
}

/* ---- what is kept between phases ------------------------------------------------------------- */

/* Facts without pointers, all of which are written down. */
typedef struct read_facts {
    uint64_t vertices, triangles;
    double origin[3];
    mn_intake intake;
    uint64_t boundary_edges, nonmanifold_edges, crossings;
    float grid_step;
    uint32_t has_colors, welded;
    int32_t unit;
    mn_vdt_figures figures;
} read_facts;

typedef struct simplify_facts {
    read_facts mesh;
    uint32_t collapses, killed_count, hinges, root_levels;
    float root_value;
    mn_build_counts counts;
} simplify_facts;

typedef struct order_facts {
    mn_tree head; /* its pointers are NULL */
    uint32_t has_colors;
    uint64_t sum[MNI_SECTIONS];
    mn_vdt_figures figures;
} order_facts;
_Static_assert(sizeof(order_facts) <= MNI_WORK_FACTS_MAX, "facts are few");

/* A mesh on its way to a tree. */
typedef struct maker {
    mn_vdt *vdt;
    const char *in;
    mn_read_desc read;
    mn_simplify_desc simplify;
    mn_work *work;
    const char *temp_dir;
    uint64_t work_bytes; /* 0: no bound */
    mni_cap cap;         /* of which it is */
    uint32_t cells_most; /* vertices of a cell, as asked for: the cap may allow fewer */
    mn_watch watch;
    mni_extmesh mesh;
    mni_history history;
    mn_status *st;
} maker;

static read_facts facts_of_mesh(const maker *m) {
    read_facts f;
    memset(&f, 0, sizeof f);
    f.vertices = m->mesh.vertices;
    f.triangles = m->mesh.triangles;
    memcpy(f.origin, m->mesh.origin, sizeof f.origin);
    f.intake = m->mesh.intake;
    f.boundary_edges = m->mesh.boundary_edges;
    f.nonmanifold_edges = m->mesh.nonmanifold_edges;
    f.crossings = m->mesh.crossings;
    f.grid_step = m->mesh.grid_step;
    f.has_colors = m->mesh.has_colors;
    f.welded = m->mesh.welded;
    f.unit = m->mesh.unit;
    f.figures = m->vdt->figures;
    return f;
}

static void take_mesh_facts(maker *m, const read_facts *f) {
    m->mesh.vertices = f->vertices;
    m->mesh.triangles = f->triangles;
    memcpy(m->mesh.origin, f->origin, sizeof f->origin);
    m->mesh.intake = f->intake;
    m->mesh.boundary_edges = f->boundary_edges;
    m->mesh.nonmanifold_edges = f->nonmanifold_edges;
    m->mesh.crossings = f->crossings;
    m->mesh.grid_step = f->grid_step;
    m->mesh.has_colors = f->has_colors != 0;
    m->mesh.welded = f->welded != 0;
    m->mesh.unit = f->unit;
    m->vdt->figures = f->figures;
}

static mn_code keep_history(maker *m) {
    const mni_history *h = &m->history;
    mni_spill *const spills[] = {&m->mesh.vertex, &m->history.collapse, &m->history.killed,
                                 &m->history.group};
    simplify_facts f;
    memset(&f, 0, sizeof f);
    f.mesh = facts_of_mesh(m);
    f.collapses = h->collapses;
    f.killed_count = h->killed_count;
    f.hinges = h->hinges;
    f.root_levels = h->root_levels;
    f.root_value = h->root_value;
    f.counts = h->counts;
    return mni_work_keep(m->work, MN_PHASE_SIMPLIFY, &f, sizeof f, spills, 4, m->st);
}

static mn_code take_history(maker *m) {
    mni_history *h = &m->history;
    mni_spill *const spills[] = {&m->mesh.vertex, &h->collapse, &h->killed, &h->group};
    simplify_facts f;
    mn_code code = mni_work_take(m->work, &f, sizeof f, spills, 4, m->st);
    if (code != MN_OK)
        return code;
    take_mesh_facts(m, &f.mesh);
    h->collapses = f.collapses;
    h->killed_count = f.killed_count;
    h->hinges = f.hinges;
    h->root_levels = f.root_levels;
    h->root_value = f.root_value;
    h->counts = f.counts;
    return MN_OK;
}

static mn_code keep_tree(maker *m) {
    mni_spill *const spills[] = {&m->vdt->made};
    order_facts f;
    memset(&f, 0, sizeof f);
    f.head = m->vdt->head;
    f.has_colors = m->vdt->has_colors;
    memcpy(f.sum, m->vdt->sum, sizeof f.sum);
    f.figures = m->vdt->figures;
    return mni_work_keep(m->work, MN_PHASE_ORDER, &f, sizeof f, spills, 1, m->st);
}

static mn_code take_tree(maker *m) {
    mni_spill *const spills[] = {&m->vdt->made};
    order_facts f;
    mn_code code = mni_work_take(m->work, &f, sizeof f, spills, 1, m->st);
    if (code != MN_OK)
        return code;
    m->vdt->head = f.head;
    m->vdt->has_colors = f.has_colors != 0;
    memcpy(m->vdt->sum, f.sum, sizeof f.sum);
    m->vdt->figures = f.figures;
    return MN_OK;
}

/* ---- phases ---------------------------------------------------------------------------------- */

/* What the process takes besides a phase's own: the program, buffers of readers and writers, stacks
 * of threads, which outlive these (HELD_BYTES: the Earth in two threads was 17.1 MB under 16.8
 * while rows were made, after rounds that took 14). Of a cap above SMALL_RAM a part is kept in
 * hand: pages that the allocator has not given back when the next phase begins (the Earth: 69.6 MB
 * under 64 without, 66.3 with it). */
enum { HELD_BYTES = 1 << 19, SMALL_RAM = 16 << 20, SPARE_PART = 11 };
enum { BESIDE_BYTES = MNI_PROGRAM_BYTES + HELD_BYTES };

static uint64_t max_u64(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

static const mni_cap ram_cap = {"--ram", BESIDE_BYTES, SMALL_RAM, SPARE_PART};
static const mni_cap work_cap = {.option = "--work-ram"};

static uint64_t work_least(uint32_t cell_vertices, uint64_t vertices) {
    return max_u64(MNI_EXTMESH_WORK_MIN,
                   max_u64(mni_rounds_work_min(cell_vertices), mni_order_work_min(vertices)));
}

uint64_t mn_vdt_ram_least(const mn_simplify_desc *simplify, uint64_t vertices) {
    const uint32_t cells = mni_rounds_cells_for(simplify->cell_vertices, simplify->work_bytes);
    return (uint64_t)mni_cap_megabytes(&ram_cap, work_least(cells, vertices)) << 20;
}

/* Each phase has all that is left by the program:
 *
 *   read      shares of it (extintake.h): at least MNI_EXTMESH_WORK_MIN, and 1 byte a vertex
 *   simplify  cells, one a thread, and buffers (rounds.c): one cell and its least buffers
 *   order     buckets and pages (order.c): grows as the square root of the model
 */
static mn_code plan_memory(maker *m, uint64_t vertices) {
    uint64_t ram = m->simplify.ram_bytes;
    if (m->read.ram_bytes > 0 && (ram == 0 || m->read.ram_bytes < ram))
        ram = m->read.ram_bytes;
    if (vertices == 0)
        m->cells_most = m->simplify.cell_vertices;
    m->simplify.cell_vertices =
        mni_rounds_cells_for(m->simplify.cell_vertices, m->simplify.work_bytes);
    const uint64_t need = work_least(m->simplify.cell_vertices, vertices);
    m->work_bytes = ram == 0 ? 0 : mni_cap_work(&ram_cap, ram);
    m->cap = ram_cap;
    const uint64_t less = m->simplify.work_bytes;
    if (less != 0 && less < need)
        return mn_fail(m->st, MN_CAP_TOO_SMALL,
                       "%s: %.1f MB to work in are too few: try --work-ram %lluM", m->in,
                       (double)less / (1 << 20), mni_megabytes(need));
    if (less != 0 && (ram == 0 || less < m->work_bytes)) {
        m->work_bytes = less;
        m->cap = work_cap;
    }
    if (ram == 0 || m->work_bytes >= need)
        return MN_OK;
    return mn_fail(m->st, MN_CAP_TOO_SMALL,
                   "%s: %.1f MB of memory are too few to simplify in: try --ram %lluM", m->in,
                   (double)ram / (1 << 20), mni_cap_megabytes(&ram_cap, need));
}

static mn_code read_phase(maker *m) {
    mni_spill *const spills[] = {&m->mesh.vertex, &m->mesh.triangle};
    const double start_s = mni_now_s(), start_cpu_s = mni_cpu_s();
    uint32_t bits = m->simplify.position_bits;
    mni_in in;
    mn_code code = mni_grid_bits(&bits, m->st);
    if (code == MN_OK)
        code = mni_in_open(&in, m->in, m->st);
    if (code != MN_OK)
        return code;
    const uint64_t in_bytes = in.size_bytes;
    mni_in_close(&in);
    uint64_t work = m->work_bytes > 0 ? m->work_bytes : UINT64_MAX;
    if (m->read.reader == MN_READER_OPENMESH && m->work_bytes > 0) { /* its process counts too */
        const uint64_t helper = mni_openmesh_bytes(m->in);
        work = work > helper + MNI_EXTMESH_WORK_MIN ? work - helper : MNI_EXTMESH_WORK_MIN;
    }
    mni_extmesh_desc desc = {.position_bits = bits,
                             .work_bytes = work,
                             .cap = m->cap,
                             .temp_dir = m->temp_dir,
                             .watch = m->watch,
                             .keep = m->work != NULL,
                             .threads = m->simplify.threads};
    code = mni_extmesh_read(m->in, &m->read, &desc, &m->mesh, m->st);
    m->vdt->figures.read = (mn_phase_figures){mni_now_s() - start_s, in_bytes + m->mesh.bytes_read,
                                              m->mesh.bytes_written, mni_cpu_s() - start_cpu_s};
    if (code == MN_OK && m->mesh.vertices >= MNI_COLLAPSE) /* ids from there on are nodes' */
        code = mn_fail(m->st, MN_BAD_INPUT,
                       "%s: has %llu vertices, more than the %u that can be simplified", m->in,
                       (unsigned long long)m->mesh.vertices, MNI_COLLAPSE - 1);
    if (code != MN_OK)
        return code;
    read_facts facts = facts_of_mesh(m);
    return mni_work_keep(m->work, MN_PHASE_READ, &facts, sizeof facts, spills, 2, m->st);
}

static mn_code simplify_phase(maker *m) {
    const double start_s = mni_now_s(), start_cpu_s = mni_cpu_s();
    const mni_rounds_desc desc = {.metric = m->simplify.metric,
                                  .cell_vertices = m->simplify.cell_vertices,
                                  .threads = m->simplify.threads,
                                  .work_bytes = m->work_bytes,
                                  .cap = m->cap,
                                  .cell_vertices_most = m->cells_most,
                                  .temp_dir = m->temp_dir,
                                  .keep = m->work != NULL,
                                  .progress = m->simplify.progress,
                                  .progress_context = m->simplify.progress_context};
    mn_code code = mni_rounds(&m->mesh, &desc, &m->history, m->st);
    if (code != MN_OK)
        return code;
    m->history.counts.seconds_simplify = mni_now_s() - start_s;
    m->vdt->figures.simplify =
        (mn_phase_figures){mni_now_s() - start_s, m->history.bytes_read, m->history.bytes_written,
                           mni_cpu_s() - start_cpu_s};
    mni_spill_close(&m->mesh.triangle);
    return keep_history(m);
}

static void fill_head(maker *m) {
    const mni_history *h = &m->history;
    mn_tree *t = &m->vdt->head;
    *t = (mn_tree){.leaves = (uint32_t)m->mesh.vertices,
                   .inner = h->collapses,
                   .simplices = h->killed_count,
                   .triangles = (uint32_t)m->mesh.triangles,
                   .roots = 1,
                   .depth_max = h->root_levels,
                   .metric = m->simplify.metric,
                   .grid_step = m->mesh.grid_step,
                   .intake = m->mesh.intake,
                   .counts = h->counts};
    t->legal_last = t->leaves - 1 + (uint32_t)h->counts.collapses_by_stage[0];
    t->counts.boundary_edges = m->mesh.boundary_edges;
    t->counts.nonmanifold_edges = m->mesh.nonmanifold_edges;
    memcpy(t->origin, m->mesh.origin, sizeof t->origin);
}

static mn_code order_phase(maker *m) {
    mn_vdt *vdt = m->vdt;
    const double start_s = mni_now_s(), start_cpu_s = mni_cpu_s();
    mni_ordered ordered;
    const mni_order_desc desc = {.work_bytes = m->work_bytes,
                                 .temp_dir = m->temp_dir,
                                 .keep = m->work != NULL,
                                 .threads = m->simplify.threads,
                                 .watch = &m->watch};
    mn_code code = mni_order(&m->history, &m->mesh, &desc, &ordered, m->st);
    if (code != MN_OK)
        return code;
    fill_head(m);
    vdt->made = ordered.file;
    vdt->has_colors = m->mesh.has_colors;
    memcpy(vdt->sum, ordered.sum, sizeof vdt->sum);
    vdt->figures.order = (mn_phase_figures){mni_now_s() - start_s, ordered.bytes_read,
                                            ordered.bytes_written, mni_cpu_s() - start_cpu_s};
    return keep_tree(m);
}

/* By what has been read. */
static mn_code plan_disk(maker *m) {
    const uint64_t ram =
        m->simplify.work_bytes != 0 ? m->simplify.work_bytes : m->simplify.ram_bytes;
    const uint64_t bytes = mni_vdt_temp_bytes_of(&m->mesh, ram);
    return m->simplify.disk == NULL ? MN_OK
                                    : m->simplify.disk(m->simplify.progress_context, bytes, m->st);
}

/* From the phase after the last that was finished. */
static mn_code go_through(maker *m) {
    mn_phase done = m->work != NULL ? mn_work_done(m->work) : MN_PHASE_NONE;
    mni_spill *const mesh[] = {&m->mesh.vertex, &m->mesh.triangle};
    read_facts facts;
    mn_code code = plan_memory(m, 0);
    if (code != MN_OK)
        return code;
    if (done == MN_PHASE_ORDER)
        return take_tree(m);
    if (done == MN_PHASE_SIMPLIFY) {
        code = take_history(m);
    } else if (done == MN_PHASE_READ) {
        code = mni_work_take(m->work, &facts, sizeof facts, mesh, 2, m->st);
        if (code == MN_OK)
            take_mesh_facts(m, &facts);
    } else {
        code = read_phase(m);
        malloc_trim(0);
    }
    if (code == MN_OK)
        code = plan_memory(m, m->mesh.vertices);
    if (code == MN_OK && done < MN_PHASE_SIMPLIFY)
        code = plan_disk(m);
    if (code == MN_OK && done < MN_PHASE_SIMPLIFY)
        code = simplify_phase(m);
    malloc_trim(0);
    return code == MN_OK ? order_phase(m) : code;
}

mn_code mn_vdt_make(const char *in, const mn_read_desc *read, const mn_simplify_desc *simplify,
                    mn_work *work, mn_vdt **out, mn_status *st) {
    mn_status own = {0};
    maker m = {.in = in,
               .work = work,
               .mesh = {.vertex = {.fd = -1}, .triangle = {.fd = -1}},
               .history = MNI_HISTORY_CLOSED,
               .st = st != NULL ? st : &own};
    *out = NULL;
    if (read != NULL)
        m.read = *read;
    if (simplify != NULL)
        m.simplify = *simplify;
    if (m.read.progress == NULL) {
        m.read.progress = m.simplify.progress;
        m.read.progress_context = m.simplify.progress_context;
    }
    m.watch = (mn_watch){m.simplify.progress, m.simplify.progress_context};
    m.temp_dir = m.simplify.temp_dir != NULL ? m.simplify.temp_dir : ".";
    m.vdt = new_vdt(m.st);
    if (m.vdt == NULL)
        return MN_FAILED;
    mn_code code = go_through(&m);
    mni_extmesh_close(&m.mesh);
    mni_history_close(&m.history);
    malloc_trim(0);
    if (code == MN_OK)
        *out = m.vdt;
    else
        mn_vdt_close(m.vdt);
    return code;
}

/* ---- a file ---------------------------------------------------------------------------------- */

static size_t item_bytes(int section) {
    return section == MNI_ROWS ? sizeof(mni_row) : sizeof(mni_row_simplex);
}

static uint64_t section_bytes(const mn_vdt *vdt, int section) {
    return (section == MNI_ROWS ? vdt->head.leaves : vdt->head.simplices) *
           (uint64_t)item_bytes(section);
}

mni_rows_source mni_vdt_source(const mn_vdt *vdt) {
    mni_rows_source s = {
        .rows = vdt->head.leaves, .simplices = vdt->head.simplices, .has_colors = vdt->has_colors};
    if (vdt->made.fd < 0) {
        s.name = vdt->path;
        s.stamp = vdt->stamp;
        s.fd = vdt->file.fd;
        s.row_offset = sizeof(mni_vdt_header);
        s.simplex_offset = s.row_offset + section_bytes(vdt, MNI_ROWS);
        return s;
    }
    s.fd = vdt->made.fd;
    s.places_offset = vdt->made.size_bytes - mni_rowpack_places(s.rows, s.simplices) * 8;
    s.grid_step = vdt->head.grid_step;
    return s;
}

typedef mn_code (*take_bytes)(void *context, const void *bytes, size_t count);

/* Hands over the rows and the simplices, from front to back; sum: what they hash to. */
static mn_code each_piece(mn_vdt *vdt, const char *phase, const mn_watch *watch,
                          uint64_t sum[MNI_SECTIONS], take_bytes take, void *context,
                          mn_status *st) {
    const mni_rows_source source = mni_vdt_source(vdt);
    const uint32_t items[MNI_SECTIONS] = {source.rows, source.simplices};
    const uint64_t all = section_bytes(vdt, MNI_ROWS) + section_bytes(vdt, MNI_SIMPLICES);
    uint64_t done = 0;
    mni_rows rows;
    void *piece = malloc(COPY_BYTES);
    mn_code code = mni_rows_open(&rows, &source, 0, st);
    if (code == MN_OK && piece == NULL)
        code = mn_fail(st, MN_FAILED, "no memory to read a tree");
    for (int i = 0; i < MNI_SECTIONS && code == MN_OK; i++) {
        const uint32_t each = (uint32_t)(COPY_BYTES / item_bytes(i));
        XXH3_state_t state;
        XXH3_64bits_reset(&state);
        for (uint32_t at = 0, end; at < items[i] && code == MN_OK; at = end) {
            end = items[i] - at < each ? items[i] : at + each;
            const size_t count = (end - at) * item_bytes(i);
            if (!mni_rows_copy(&rows, i == MNI_SIMPLICES, at, end, piece))
                code = mni_rows_trouble(&rows, st);
            if (code != MN_OK)
                break;
            XXH3_64bits_update(&state, piece, count);
            done += count;
            if (take != NULL)
                code = take(context, piece, count);
            if (code == MN_OK)
                code = mni_watch(watch, phase, done, all, st);
        }
        sum[i] = XXH3_64bits_digest(&state);
    }
    mni_rows_close(&rows);
    free(piece);
    return code;
}

static mn_code open_file(mn_vdt *vdt, const mn_watch *watch, mn_status *st) {
    mni_vdt_header h;
    uint64_t sum[MNI_SECTIONS];
    mn_code code = mni_in_open(&vdt->file, vdt->path, st);
    if (code != MN_OK) {
        vdt->file.fd = -1;
        return code;
    }
    vdt->stamp = mni_rows_stamp(vdt->file.fd);
    code = mni_vdt_header_read(&vdt->file, vdt->path, &h, &vdt->head, st);
    if (code != MN_OK)
        return code;
    vdt->has_colors = mni_vdt_header_has_colors(&h);
    const double start_s = mni_now_s(), start_cpu_s = mni_cpu_s();
    code = each_piece(vdt, "checking", watch, sum, NULL, NULL, st);
    vdt->figures.read = (mn_phase_figures){mni_now_s() - start_s, vdt->file.size_bytes, 0,
                                           mni_cpu_s() - start_cpu_s};
    for (int i = 0; i < MNI_SECTIONS && code == MN_OK; i++) {
        vdt->sum[i] = sum[i];
        if (sum[i] != h.section[i].checksum)
            code = mn_fail(st, MN_BAD_INPUT,
                           "%s: %s (at byte %llu): checksum does not match; simplify again",
                           vdt->path, i == MNI_ROWS ? "rows" : "simplices",
                           (unsigned long long)h.section[i].offset);
    }
    return code;
}

static mn_code open_blocks(mn_vdt *vdt, const mn_open_desc *desc, mn_status *st) {
    const double start_s = mni_now_s(), start_cpu_s = mni_cpu_s();
    mni_ordered ordered;
    mn_code code = mni_mnt_spill(vdt->path, desc, &ordered, &vdt->head, &vdt->has_colors, st);
    vdt->made = ordered.file;
    memcpy(vdt->sum, ordered.sum, sizeof vdt->sum);
    vdt->figures.read = (mn_phase_figures){mni_now_s() - start_s, ordered.bytes_read,
                                           ordered.bytes_written, mni_cpu_s() - start_cpu_s};
    return code;
}

mn_code mn_vdt_open(const char *path, const mn_open_desc *desc, mn_vdt **out, mn_status *st) {
    static const mn_open_desc defaults = {0};
    mn_vdt *vdt = new_vdt(st);
    mn_code code = MN_FAILED;
    *out = NULL;
    if (vdt == NULL)
        return code;
    desc = desc != NULL ? desc : &defaults;
    vdt->path = strdup(path);
    if (vdt->path == NULL)
        mn_fail(st, MN_FAILED, "no memory for a tree");
    else
        code = mn_tree_is_vdt(path) ? open_file(vdt, desc->watch, st) : open_blocks(vdt, desc, st);
    if (code == MN_OK)
        *out = vdt;
    else
        mn_vdt_close(vdt);
    return code;
}

uint64_t mn_vdt_open_temp_bytes(uint64_t vertices, uint64_t triangles) {
    return vertices * ROW_PACKED_MOST + triangles * SIMPLEX_PACKED_MOST;
}

typedef struct copy {
    mni_out out;
    mn_status *st;
} copy;

static mn_code put_out(void *context, const void *bytes, size_t count) {
    copy *c = context;
    return mni_out_write(&c->out, bytes, count, c->st);
}

mn_code mn_vdt_write(mn_vdt *vdt, const char *path, const mn_watch *watch, mn_status *st) {
    copy c = {.out = {.fd = -1}, .st = st};
    mni_vdt_header h;
    uint64_t sum[MNI_SECTIONS];
    const char *name = vdt->path != NULL ? vdt->path : "temporary file";
    mni_vdt_header_make(&h, &vdt->head, vdt->has_colors, vdt->sum);
    mn_code code = mni_out_open(&c.out, path, st);
    if (code == MN_OK)
        code = mni_out_write(&c.out, &h, sizeof h, st);
    if (code == MN_OK)
        code = each_piece(vdt, "writing", watch, sum, put_out, &c, st);
    if (code == MN_OK && memcmp(sum, vdt->sum, sizeof sum) != 0)
        code = mn_fail(st, MN_FAILED, "%s: has changed while it was copied", name);
    if (code == MN_OK)
        code = mni_out_commit(&c.out, st);
    mni_out_abort(&c.out);
    return code;
}

mn_code mn_vdt_block(mn_vdt *vdt, const char *path, const mn_block_desc *desc, mn_header *header,
                     mn_block_counts *counts, mn_status *st) {
    mn_block_desc checked = desc != NULL ? *desc : (mn_block_desc){0};
    mn_code code = mni_block_desc_check(path, &vdt->head, &checked, st);
    if (code != MN_OK)
        return code;
    const mni_rows_source source = mni_vdt_source(vdt);
    uint64_t build_id = mni_build_id(&vdt->head, vdt->has_colors, vdt->sum, &checked);
    return mni_block_rows(path, &vdt->head, &source, build_id, &checked, header, counts, st);
}
