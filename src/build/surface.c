/* See surface.h. What is hidden here: how incidence is kept, and when a hinge is made. */
#include "surface.h"

#include <stdlib.h>
#include <string.h>

#include "mem.h"
#include "mn_assert.h"

enum { LINE_BYTES = 64 };
_Static_assert(sizeof(mni_vertex) == 2 * LINE_BYTES && offsetof(mni_vertex, xy) == LINE_BYTES,
               "a vertex is two lines");

#define VERTEX_NONE (MN_NONE - 1) /* a hinge's third corner is MN_NONE */
enum { LONG_FAN = 1024 };         /* which is not walked without need */
enum { FAN_SLACK = 4 }; /* free places behind each list at the start: what a collapse adds to six */

static mn_code no_memory(mn_status *st) {
    return mn_fail(st, MN_FAILED,
                   "out of memory while simplifying: close something, or use a machine with more");
}

mn_code mni_surface_room(mni_surface *s, uint32_t vertices, uint32_t triangles, uint32_t hinges,
                         mn_status *st) {
    uint32_t simplices = triangles + hinges;
    *s = (mni_surface){.vertices = vertices,
                       .triangles = triangles,
                       .simplices = simplices,
                       .alive_triangles = triangles,
                       .alive_hinges = hinges};
    /* Hinges are rare (one in 10^5 triangles of a scan); loose triangles make one each. */
    s->simplices_room = simplices + triangles / 64 + 16;
    s->pool_room = (size_t)triangles * 3 + (size_t)hinges * 2 + (size_t)vertices * FAN_SLACK +
                   (size_t)triangles + 64;
    if (s->pool_room > UINT32_MAX)
        return mn_fail(st, MN_CAP_TOO_SMALL, "%u triangles are too many to simplify in memory",
                       triangles);
    s->simplex =
        mni_mem_take(s->simplices_room * sizeof *s->simplex, simplices * sizeof *s->simplex);
    s->origin = mni_mem_take((size_t)s->simplices_room * 3 * sizeof *s->origin,
                             (size_t)simplices * 3 * sizeof *s->origin);
    s->vertex = mni_mem_take(vertices * sizeof *s->vertex, vertices * sizeof *s->vertex);
    s->pool =
        mni_mem_take(s->pool_room * sizeof *s->pool, (s->pool_room - triangles) * sizeof *s->pool);
    if (s->simplex == NULL || s->origin == NULL || s->vertex == NULL || s->pool == NULL) {
        mni_surface_close(s);
        return no_memory(st);
    }
    return MN_OK;
}

static int corners_of(const mni_simplex *x) {
    return x->v[2] == MN_NONE ? 2 : 3;
}

void mni_surface_index(mni_surface *s) {
    for (uint32_t x = 0; x < s->simplices; x++)
        for (int c = 0; c < corners_of(&s->simplex[x]); c++)
            s->vertex[s->simplex[x].v[c]].fan.room++;
    uint32_t at = 0;
    for (uint32_t v = 0; v < s->vertices; v++) {
        mni_fan *f = &s->vertex[v].fan;
        f->first = at;
        f->room += FAN_SLACK;
        at += f->room;
    }
    for (uint32_t x = 0; x < s->simplices; x++)
        for (int c = 0; c < corners_of(&s->simplex[x]); c++) {
            mni_fan *f = &s->vertex[s->simplex[x].v[c]].fan;
            s->pool[f->first + f->count++] = x;
        }
    s->pool_used = at;
}

mn_code mni_surface_open(mni_surface *s, const mn_mesh *mesh, mn_status *st) {
    mn_code code = mni_surface_room(s, mesh->vertices, mesh->triangles, 0, st);
    if (code != MN_OK)
        return code;
    memcpy(s->origin, mesh->corner, (size_t)mesh->triangles * 3 * sizeof *s->origin);
    for (uint32_t t = 0; t < mesh->triangles; t++) {
        const uint32_t *c = &mesh->corner[3 * (size_t)t];
        s->simplex[t] = (mni_simplex){{c[0], c[1], c[2]}, MN_NONE};
    }
    for (uint32_t v = 0; v < s->vertices; v++) {
        const float *p = &mesh->position[3 * (size_t)v];
        s->vertex[v] = (mni_vertex){.p = {p[0], p[1], p[2]}, .set = MN_NONE, .node = v};
    }
    mni_surface_index(s);
    return MN_OK;
}

void mni_surface_close(mni_surface *s) {
    mni_mem_give(s->simplex);
    mni_mem_give(s->origin);
    mni_mem_give(s->vertex);
    mni_mem_give(s->pool);
    free(s->dead);
    memset(s, 0, sizeof *s);
}

const uint32_t *mni_surface_fan(mni_surface *s, uint32_t v, uint32_t *count) {
    mni_fan *f = &s->vertex[v].fan;
    uint32_t *list = &s->pool[f->first];
    uint32_t kept = 0;
    s->walked += f->count > LONG_FAN ? f->count : 0;
    for (uint32_t i = 0; i < f->count; i++) {
        uint32_t x = list[i];
        list[kept] = x;
        kept += s->simplex[x].killed == MN_NONE;
    }
    f->count = kept;
    *count = kept;
    return list;
}

/* Whether a long list has too many alive for a wheel, by looking at a few of them here and there.
 * False: perhaps not; then most of it is dead, and to clean it is paid for by those that died. */
static bool seems_long(const mni_surface *s, const mni_fan *f) {
    enum { LOOKS = 64 };
    uint32_t alive = 0;
    if (f->count <= LONG_FAN)
        return false;
    for (uint32_t i = 0; i < LOOKS && alive <= MNI_WHEEL_MAX; i++) {
        uint32_t at = (uint32_t)((uint64_t)f->count * i / LOOKS);
        alive += s->simplex[s->pool[f->first + at]].killed == MN_NONE;
    }
    return alive > MNI_WHEEL_MAX;
}

enum { FOUR = 4 };

/* Four simplices, as lanes: their first corners, their second ones, and so on. */
typedef struct four_simplices {
    mni_four id, v[3], killed;
} four_simplices;

/* From list[i] on; behind its end comes the first one again. */
static inline __attribute__((always_inline)) four_simplices
take_four(const mni_surface *s, const uint32_t *list, uint32_t i, uint32_t count) {
    mni_four x[FOUR];
    four_simplices four;
    for (uint32_t l = 0; l < FOUR; l++) {
        uint32_t at = list[i + (l & (0u - (i + l < count)))]; /* no branch */
        four.id[l] = at;
        memcpy(&x[l], &s->simplex[at], sizeof x[l]);
    }
    mni_four a = __builtin_shufflevector(x[0], x[1], 0, 4, 1, 5);
    mni_four b = __builtin_shufflevector(x[2], x[3], 0, 4, 1, 5);
    mni_four c = __builtin_shufflevector(x[0], x[1], 2, 6, 3, 7);
    mni_four d = __builtin_shufflevector(x[2], x[3], 2, 6, 3, 7);
    four.v[0] = __builtin_shufflevector(a, b, 0, 1, 4, 5);
    four.v[1] = __builtin_shufflevector(a, b, 2, 3, 6, 7);
    four.v[2] = __builtin_shufflevector(c, d, 0, 1, 4, 5);
    four.killed = __builtin_shufflevector(c, d, 2, 3, 6, 7);
    return four;
}

/* Four of v's list, from list[i] on, to the wheel, where `kept` are; the dead ones leave both.
 * Returns how many are kept then. */
static inline __attribute__((always_inline)) uint32_t read_four(const mni_surface *s, uint32_t v,
                                                                mni_wheel *wheel, uint32_t *list,
                                                                uint32_t i, uint32_t count,
                                                                uint32_t kept, uint32_t *hinges) {
    const four_simplices x = take_four(s, list, i, count);
    const mni_four second = (mni_four)(x.v[1] == v), third = (mni_four)(x.v[2] == v);
    const mni_four first = ~(second | third);
    const mni_four alive =
        (mni_four)(x.killed == MN_NONE) & (mni_four)((mni_four){0, 1, 2, 3} < count - i);
    const mni_four next = (x.v[1] & first) | (x.v[2] & second) | (x.v[0] & third) | ~alive;
    const mni_four previous = (x.v[2] & first) | (x.v[0] & second) | (x.v[1] & third) | ~alive;
    const mni_four hinge = alive & (mni_four)(x.v[2] == MN_NONE);
    const uint32_t bits = mni_four_bits(&alive);
    *hinges |= mni_four_bits(&hinge);
    if ((bits & (bits + 1)) == 0) { /* none dead before one alive */
        memcpy(&wheel->simplex[kept], &x.id, sizeof x.id);
        memcpy(&wheel->next[kept], &next, sizeof next);
        memcpy(&wheel->previous[kept], &previous, sizeof previous);
        for (uint32_t l = 0; kept != i && l < FOUR && (bits >> l & 1) != 0; l++)
            list[kept + l] = x.id[l];
        return kept + (uint32_t)__builtin_ctz(~bits); /* as many as are alive */
    }
    for (uint32_t l = 0; l < FOUR; l++) { /* the place may be the last one, and stays free */
        if ((bits >> l & 1) == 0)
            continue;
        wheel->simplex[kept] = list[kept] = x.id[l];
        wheel->next[kept] = next[l];
        wheel->previous[kept++] = previous[l];
    }
    return kept;
}

bool mni_surface_wheel(mni_surface *s, uint32_t v, mni_wheel *wheel) {
    mni_fan *f = &s->vertex[v].fan;
    if (f->count > MNI_WHEEL_MAX) {
        if (seems_long(s, f))
            return false;
        uint32_t count;
        mni_surface_fan(s, v, &count);
        if (count > MNI_WHEEL_MAX)
            return false;
    }
    memset(wheel->next, 0xff, sizeof wheel->next);
    memset(wheel->previous, 0xff, sizeof wheel->previous);
    uint32_t *list = &s->pool[f->first];
    uint32_t kept = 0, hinges = 0;
    for (uint32_t i = 0; i < f->count; i += FOUR)
        kept = read_four(s, v, wheel, list, i, f->count, kept, &hinges);
    f->count = wheel->count = kept;
    return hinges == 0;
}

static bool holds(const mni_simplex *x, uint32_t v) {
    return x->v[0] == v || x->v[1] == v || x->v[2] == v;
}

/* The dead ones that are met leave the list: so none is met twice. */
bool mni_surface_joined_beside(mni_surface *s, uint32_t a, uint32_t b, uint32_t but) {
    mni_fan *f = &s->vertex[a].fan;
    uint32_t *list = &s->pool[f->first];
    for (uint32_t i = 0; i < f->count; s->walked++) {
        const mni_simplex *x = &s->simplex[list[i]];
        if (x->killed != MN_NONE)
            list[i] = list[--f->count];
        else if (holds(x, b) && !holds(x, but))
            return true;
        else
            i++;
    }
    return false;
}

bool mni_surface_joined(mni_surface *s, uint32_t a, uint32_t b) {
    if (s->vertex[a].fan.count > s->vertex[b].fan.count) {
        uint32_t t = a;
        a = b;
        b = t;
    }
    if (s->vertex[a].fan.count > LONG_FAN)
        return mni_surface_joined_beside(s, a, b, VERTEX_NONE);
    const uint32_t *list = &s->pool[s->vertex[a].fan.first];
    for (uint32_t i = 0; i < s->vertex[a].fan.count; i++) {
        const mni_simplex *x = &s->simplex[list[i]];
        if (x->killed == MN_NONE && holds(x, b))
            return true;
    }
    return false;
}

/* Packs all lists to the front of a new pool, half as large again as what is alive. No list has
 * room to spare after that. */
static bool pack_pool(mni_surface *s, uint32_t wanted) {
    size_t alive = 0;
    for (uint32_t v = 0; v < s->vertices; v++) {
        uint32_t count;
        mni_surface_fan(s, v, &count);
        alive += count;
    }
    size_t room = alive + alive / 2 + 2 * (size_t)wanted + 64;
    if (room > UINT32_MAX) /* places in it are 32 bits */
        return false;
    uint32_t *pool = mni_mem_take(room * sizeof *pool, 0);
    if (pool == NULL)
        return false;
    size_t at = 0;
    for (uint32_t v = 0; v < s->vertices; v++) {
        mni_fan *f = &s->vertex[v].fan;
        memcpy(&pool[at], &s->pool[f->first], f->count * sizeof *pool);
        f->first = (uint32_t)at;
        f->room = f->count;
        at += f->count;
    }
    mni_mem_give(s->pool);
    s->pool = pool;
    s->pool_room = room;
    s->pool_used = at;
    return true;
}

/* Makes room for `more` entries behind k's list. */
static bool reserve(mni_surface *s, uint32_t k, uint32_t more) {
    uint32_t count;
    mni_fan *f = &s->vertex[k].fan;
    if (f->count + more <= f->room)
        return true;
    mni_surface_fan(s, k, &count);
    uint32_t need = count + more;
    if (need <= f->room - f->room / 8) /* or it would be cleaned again after a few */
        return true;
    uint32_t room = need + need / 2;
    if (s->pool_used + room > s->pool_room && !pack_pool(s, room))
        return false;
    memcpy(&s->pool[s->pool_used], &s->pool[f->first], count * sizeof *s->pool);
    f->first = (uint32_t)s->pool_used;
    f->room = room;
    s->pool_used += room;
    return true;
}

static bool add_hinge(mni_surface *s, uint32_t k, uint32_t w, uint32_t of) {
    if (s->simplices == s->simplices_room) {
        uint32_t room = s->simplices_room + s->simplices_room / 4;
        mni_simplex *simplex =
            mni_mem_grow(s->simplex, s->simplices * sizeof *simplex, room * sizeof *simplex);
        if (simplex == NULL)
            return false;
        s->simplex = simplex;
        uint32_t *origin = mni_mem_grow(s->origin, (size_t)s->simplices * 3 * sizeof *origin,
                                        (size_t)room * 3 * sizeof *origin);
        if (origin == NULL)
            return false;
        s->origin = origin;
        s->simplices_room = room;
    }
    uint32_t x = s->simplices;
    const mni_simplex *t = &s->simplex[of];
    uint32_t *o = &s->origin[3 * (size_t)x];
    for (int c = 0; c < 3; c++) {
        if (t->v[c] == k)
            o[0] = s->origin[3 * (size_t)of + c];
        if (t->v[c] == w)
            o[1] = s->origin[3 * (size_t)of + c];
    }
    o[2] = MN_NONE;
    s->simplex[x] = (mni_simplex){{k, w, MN_NONE}, MN_NONE};
    const uint32_t ends[2] = {k, w};
    /* one by one: reserving may pack, which takes unused room back */
    for (int i = 0; i < 2; i++) {
        if (!reserve(s, ends[i], 1))
            return false;
        mni_fan *f = &s->vertex[ends[i]].fan;
        s->pool[f->first + f->count++] = x;
    }
    s->simplices++;
    s->alive_hinges++;
    return true;
}

static uint32_t apex_of(const mni_simplex *x, uint32_t r, uint32_t k) {
    const uint32_t *v = x->v;
    return v[0] != r && v[0] != k ? v[0] : v[1] != r && v[1] != k ? v[1] : v[2];
}

/* Of the triangles that died with w as their apex, the first in the input. They are among the dead,
 * and on w's list still, unless it was long and has been walked: the shorter one is looked through.
 */
static uint32_t first_dead(mni_surface *s, uint32_t r, uint32_t k, uint32_t w, uint32_t dead,
                           uint32_t collapse) {
    const mni_fan *f = &s->vertex[w].fan;
    uint32_t first = MN_NONE;
    if (f->count <= dead && f->count <= LONG_FAN)
        for (uint32_t i = 0; i < f->count; i++) {
            uint32_t x = s->pool[f->first + i];
            if (s->simplex[x].killed == collapse && x < first)
                first = x;
        }
    if (first == MN_NONE) {
        s->walked += dead > LONG_FAN ? dead : 0;
        for (uint32_t i = 0; i < dead; i++)
            if (s->dead[i] < first && apex_of(&s->simplex[s->dead[i]], r, k) == w)
                first = s->dead[i];
    }
    MN_ASSERT(first < s->triangles);
    return first;
}

/* Where nothing alive joins k to the apex of a triangle that died, a hinge does from now on. Its
 * vertices are lent by the first such triangle; these are found before a hinge is made, since that
 * may walk lists. */
static bool hinge_apexes(mni_surface *s, uint32_t r, uint32_t k, uint32_t dead, uint32_t collapse) {
    uint32_t apart = 0, last = MN_NONE; /* thousands of triangles may have come to be one */
    for (uint32_t i = 0; i < dead; i++) {
        uint32_t w = apex_of(&s->simplex[s->dead[i]], r, k);
        if (w != last && !mni_surface_joined(s, k, w))
            s->dead[apart++] = first_dead(s, r, k, w, dead, collapse);
        last = w;
    }
    for (uint32_t i = 0; i < apart; i++) {
        uint32_t w = apex_of(&s->simplex[s->dead[i]], r, k);
        if (!mni_surface_joined(s, k, w) && !add_hinge(s, k, w, s->dead[i]))
            return false;
    }
    return true;
}

static bool is_trio(const mni_surface *s, const mni_simplex *x) {
    return x->v[2] != MN_NONE && s->vertex[x->v[0]].hub && s->vertex[x->v[1]].hub &&
           s->vertex[x->v[2]].hub;
}

bool mni_surface_collapse(mni_surface *s, uint32_t r, uint32_t k, uint32_t collapse) {
    uint32_t count;
    mni_surface_fan(s, r, &count);
    if (count > s->dead_room) {
        uint32_t *dead_list = realloc(s->dead, 2 * (size_t)count * sizeof *dead_list);
        if (dead_list == NULL)
            return false;
        s->dead = dead_list;
        s->dead_room = 2 * count;
    }
    const uint32_t *list = &s->pool[s->vertex[r].fan.first];
    uint32_t moving = 0;
    for (uint32_t i = 0; i < count; i++)
        moving += !holds(&s->simplex[list[i]], k);
    if (!reserve(s, k, moving))
        return false;
    list = &s->pool[s->vertex[r].fan.first];
    mni_fan *to = &s->vertex[k].fan;
    uint32_t dead = 0;
    for (uint32_t i = 0; i < count; i++) {
        mni_simplex *x = &s->simplex[list[i]];
        if (!holds(x, k)) {
            x->v[x->v[0] == r ? 0 : x->v[1] == r ? 1 : 2] = k;
            s->pool[to->first + to->count++] = list[i];
            s->trios += s->vertex[k].hub && is_trio(s, x);
            continue;
        }
        x->killed = collapse;
        if (x->v[2] == MN_NONE) {
            s->alive_hinges--;
        } else {
            s->alive_triangles--;
            s->dead[dead++] = list[i];
        }
    }
    s->vertex[r].fan.count = 0;
    return hinge_apexes(s, r, k, dead, collapse);
}

bool mni_surface_collapse_round(mni_surface *s, const mni_wheel *wheel, uint32_t r, uint32_t k,
                                uint32_t collapse) {
    uint32_t moved[MNI_WHEEL_MAX], count = 0;
    if (!reserve(s, k, wheel->count - 2))
        return false;
    for (uint32_t i = 0; i < wheel->count; i++) {
        bool dies = (wheel->next[i] == k) | (wheel->previous[i] == k);
        mni_simplex *x = &s->simplex[wheel->simplex[i]];
        x->v[mni_simplex_corner(x, r).at] = k;
        x->killed = dies ? collapse : MN_NONE;
        moved[count] = wheel->simplex[i];
        count += !dies;
    }
    for (uint32_t i = 0; i < count && s->vertex[k].hub; i++)
        s->trios += is_trio(s, &s->simplex[moved[i]]);
    MN_ASSERT(count == wheel->count - 2);
    mni_fan *to = &s->vertex[k].fan;
    memcpy(&s->pool[to->first + to->count], moved, count * sizeof *moved);
    to->count += count;
    s->vertex[r].fan.count = 0;
    s->alive_triangles -= 2;
    return true;
}
