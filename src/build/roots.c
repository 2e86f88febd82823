/* Stage 4: the roots of the components become one tree, by virtual edges between nearest roots.
 *
 * The shortest distance between any two roots goes first (ties by vertex numbers, kept then
 * removed). Each root knows its nearest other root; a heap holds these. Roots lie in a grid of
 * cells about as many as roots; a search goes outwards cell ring by cell ring until the best found
 * is nearer than the next ring. When half of the roots are gone the grid is laid anew. So the work
 * is about n log n for roots that are spread as models' are. Paper: §2.1.1 (virtual edges; there
 * the neighbours come from a Voronoi diagram). One thread; memory: 28 bytes a root and the grid. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "simplify.h"

typedef struct root_grid {
    const float *position;
    uint32_t *alive; /* vertices that are roots */
    uint32_t count, laid_count;
    uint32_t cells[3];
    float low[3], cell_size;
    uint32_t *head, *next; /* next: a vertex */
    uint32_t *head_room;
} root_grid;

static void cell_of(const root_grid *g, uint32_t v, uint32_t cell[3]) {
    for (int i = 0; i < 3; i++) {
        float x = (g->position[3 * (size_t)v + i] - g->low[i]) / g->cell_size;
        uint32_t c = x > 0 ? (uint32_t)x : 0;
        cell[i] = c < g->cells[i] ? c : g->cells[i] - 1;
    }
}

static uint32_t *cell_head(const root_grid *g, uint32_t x, uint32_t y, uint32_t z) {
    return &g->head[((size_t)z * g->cells[1] + y) * g->cells[0] + x];
}

/* Lays the grid over the roots that are left: cubes, about two roots a cube. */
static bool lay(root_grid *g) {
    float high[3];
    for (int i = 0; i < 3; i++) {
        g->low[i] = INFINITY;
        high[i] = -INFINITY;
    }
    for (uint32_t a = 0; a < g->count; a++)
        for (int i = 0; i < 3; i++) {
            float x = g->position[3 * (size_t)g->alive[a] + i];
            g->low[i] = x < g->low[i] ? x : g->low[i];
            high[i] = x > high[i] ? x : high[i];
        }
    float widest = 0;
    for (int i = 0; i < 3; i++)
        widest = high[i] - g->low[i] > widest ? high[i] - g->low[i] : widest;
    if (!(widest > 0))
        widest = 1;
    /* Shrink cubes until there are about half as many as roots: flat models have few layers. */
    double cells = 1;
    g->cell_size = widest;
    for (int halvings = 0; halvings < 20; halvings++) {
        double size = g->cell_size / 1.26, more = 1; /* each step doubles the number of cubes */
        for (int i = 0; i < 3; i++)
            more *= floor((high[i] - g->low[i]) / size) + 1;
        if (more > g->count / 2.0 + 1)
            break;
        g->cell_size = (float)size;
        cells = more;
    }
    (void)cells;
    size_t total = 1;
    for (int i = 0; i < 3; i++) {
        g->cells[i] = (uint32_t)((high[i] - g->low[i]) / g->cell_size) + 1;
        total *= g->cells[i];
    }
    uint32_t *head = realloc(g->head, total * sizeof *head);
    if (head == NULL)
        return false;
    g->head = head;
    memset(head, 0xff, total * sizeof *head);
    for (uint32_t a = 0; a < g->count; a++) {
        uint32_t cell[3], v = g->alive[a];
        cell_of(g, v, cell);
        uint32_t *at = cell_head(g, cell[0], cell[1], cell[2]);
        g->next[v] = *at;
        *at = v;
    }
    g->laid_count = g->count;
    return true;
}

static void take_out(root_grid *g, uint32_t v) {
    uint32_t cell[3];
    cell_of(g, v, cell);
    uint32_t *at = cell_head(g, cell[0], cell[1], cell[2]);
    while (*at != v)
        at = &g->next[*at];
    *at = g->next[v];
}

static float distance2(const root_grid *g, uint32_t a, uint32_t b) {
    float sum = 0;
    for (int i = 0; i < 3; i++) {
        float d = g->position[3 * (size_t)a + i] - g->position[3 * (size_t)b + i];
        sum += d * d;
    }
    return sum;
}

static void search_cell(const root_grid *g, uint32_t r, const int64_t c[3], mni_heap_key *best) {
    for (int i = 0; i < 3; i++)
        if (c[i] < 0 || c[i] >= g->cells[i])
            return;
    for (uint32_t v = *cell_head(g, (uint32_t)c[0], (uint32_t)c[1], (uint32_t)c[2]); v != MN_NONE;
         v = g->next[v]) {
        mni_heap_key key = {distance2(g, r, v), v};
        if (v != r && mni_heap_key_less(key, r, *best, r))
            *best = key;
    }
}

/* r's nearest other root. */
static mni_heap_key nearest(const root_grid *g, uint32_t r) {
    mni_heap_key best = {INFINITY, MN_NONE};
    uint32_t middle[3];
    cell_of(g, r, middle);
    uint32_t most = 0;
    for (int i = 0; i < 3; i++)
        most = g->cells[i] > most ? g->cells[i] : most;
    for (int64_t ring = 0; ring <= most; ring++) {
        /* Everything in the rings so far is nearer than this. */
        float safe = (float)(ring - 1) * g->cell_size;
        if (ring > 0 && best.cost < safe * safe)
            break;
        for (int64_t z = -ring; z <= ring; z++)
            for (int64_t y = -ring; y <= ring; y++) {
                bool shell = z == -ring || z == ring || y == -ring || y == ring;
                int64_t step = shell || ring == 0 ? 1 : 2 * ring;
                for (int64_t x = -ring; x <= ring; x += step) {
                    int64_t c[3] = {middle[0] + x, middle[1] + y, middle[2] + z};
                    search_cell(g, r, c, &best);
                }
            }
    }
    return best;
}

static mn_code join(mni_simplifier *s, root_grid *g) {
    for (uint32_t a = 0; a < g->count; a++)
        mni_heap_set(&s->heap, g->alive[a], nearest(g, g->alive[a]));
    uint32_t left = g->count;
    while (left > 1) {
        uint32_t r = mni_heap_top(&s->heap);
        mni_heap_key key = mni_heap_key_of(&s->heap, r);
        if (s->node[key.kept] == MN_NONE) { /* its nearest has gone: find another */
            mni_heap_set(&s->heap, r, nearest(g, r));
            continue;
        }
        mni_heap_remove(&s->heap, r);
        take_out(g, r);
        left--;
        mn_code code = mni_simplify_record(s, r, key.kept);
        if (code != MN_OK)
            return code;
        if (left > 16 && left < g->laid_count / 2) {
            uint32_t kept = 0;
            for (uint32_t a = 0; a < g->count; a++)
                if (s->node[g->alive[a]] != MN_NONE)
                    g->alive[kept++] = g->alive[a];
            g->count = kept;
            if (!lay(g))
                return mn_fail(s->st, MN_FAILED, "out of memory while joining components");
        }
    }
    return MN_OK;
}

mn_code mni_simplify_roots(mni_simplifier *s) {
    uint32_t roots = s->mesh->vertices - s->made.count;
    if (roots == 1)
        return MN_OK;
    root_grid g = {.position = s->mesh->position,
                   .alive = malloc(roots * sizeof *g.alive),
                   .next = malloc((size_t)s->mesh->vertices * sizeof *g.next)};
    mn_code code = MN_OK;
    if (g.alive == NULL || g.next == NULL)
        code = mn_fail(s->st, MN_FAILED, "out of memory while joining %u components", roots);
    for (uint32_t v = 0; code == MN_OK && v < s->mesh->vertices; v++)
        if (s->node[v] != MN_NONE)
            g.alive[g.count++] = v;
    if (code == MN_OK && !lay(&g))
        code = mn_fail(s->st, MN_FAILED, "out of memory while joining %u components", roots);
    if (code == MN_OK)
        code = join(s, &g);
    free(g.alive);
    free(g.next);
    free(g.head);
    return code;
}
