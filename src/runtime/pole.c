/* Poles: nodes of so many corners that nothing may look through them all.
 *
 * The rim of a fan of n triangles changes n times, and its middle as often: looking through the
 * middle's corners each time would be n². Four things are asked of a pole: to forget a corner, to
 * give up those of leaves from some leaf on (its right child's), and for neighbours of larger order
 * ids than its own, or of lower ones above them than a fork's. So its corners stand in a tree: by
 * the bits of a hash, down to packed lists of a few chunks; and of each part is known a bound of
 * its leaves, of its neighbours' order ids and of those above them. Whoever seeks goes where the
 * bounds let him hope, and corrects them where he hoped in vain.
 *
 *      pole ── bound ── fork ─┬─ bound ── fork ─┬─ bound ── list: 4 corners, then 7, then 7
 *                             │                 └─ bound ── list: 6 corners
 *                             └─ bound ── list: 1 corner, then 7
 *
 * A part, in a fork or of the whole: MN_NONE, the first chunk of a list, or FORK + a fork's chunk.
 * Hides: that tree. A bound is true at any time, if not the best: when a node moves, the poles next
 * to it are told (tell). Two poles may share all of their triangles; so a pole's bounds leave out
 * other poles, of which there are few: each keeps who may be next to it, and looks at those.
 *
 * Any order of calls. Threads: Navigate only. Memory: the front's chunks that its lists do not
 * need; where few are left trees do not grow, where none is left poles become lists (give_way).
 * Paper: none. */
#include "pole.h"

#include "corners.h"
#include "mn_assert.h"

#define FORK 0x80000000u
enum {
    FORK_CHUNKS = 6,  /* a list that needs more becomes two */
    MERGE_CHUNKS = 3, /* two that have no more become one */
    DEPTH_MAX = 24,
    SPARE = 16, /* that share of all chunks is left alone */
};

static const mni_pole_bound nothing = {.leaf = 0, .order = 0, .above = MN_NONE};

static mni_front_chunk *of(const mni_front *f, uint32_t slot) {
    return &f->chunk[f->node[slot].more & ~MNI_FRONT_POLE];
}

static bool is_fork(uint32_t part) {
    return part != MN_NONE && (part & FORK) != 0;
}

static mni_front_chunk *fork_at(const mni_front *f, uint32_t part) {
    return &f->chunk[part & ~FORK];
}

static uint32_t hash_of(uint32_t corner) {
    return corner * 0x9e3779b1u;
}

static bool has_spare(const mni_front *f) {
    return mni_chunks_left(f) > f->chunks_max / SPARE + 4;
}

/* ---- bounds ---------------------------------------------------------------------------------- */

static void add(mni_pole_bound *b, const mni_pole_bound *other) {
    b->leaf = other->leaf > b->leaf ? other->leaf : b->leaf;
    b->order = other->order > b->order ? other->order : b->order;
    b->above = other->above < b->above ? other->above : b->above;
}

/* The slot of a corner's neighbour, of two; nobody's where there is none. */
static uint32_t beside(const mni_front *f, uint32_t corner, int which) {
    return mni_corner_slot(f, which ? mni_corner_before(corner) : mni_corner_after(corner));
}

static void add_neighbours(const mni_front *f, uint32_t corner, mni_pole_bound *b) {
    for (int k = 0; k < 2; k++) {
        const mni_front_node *n = &f->node[beside(f, corner, k)];
        if (!mni_front_is_pole(n))
            add(b, &(mni_pole_bound){0, n->order, n->above});
    }
}

static mni_pole_bound bound_of(const mni_front *f, uint32_t corner) {
    mni_pole_bound b = {f->simplex_leaf[mni_corner_at(corner)], 0, MN_NONE};
    add_neighbours(f, corner, &b);
    return b;
}

static mni_pole_bound both(const mni_front_chunk *fork) {
    mni_pole_bound b = fork->fork.bound[0];
    add(&b, &fork->fork.bound[1]);
    return b;
}

/* ---- the tree -------------------------------------------------------------------------------- */

static void put(mni_front *f, uint32_t *part, mni_pole_bound *bound, uint32_t corner,
                const mni_pole_bound *its, uint32_t depth);

/* A list becomes a fork of two. */
static void divide(mni_front *f, uint32_t *part, uint32_t depth) {
    const uint32_t chunk = mni_chunk_new(f);
    uint32_t more = *part;
    *part = chunk | FORK;
    mni_front_chunk *fork = &f->chunk[chunk];
    fork->fork.part[0] = fork->fork.part[1] = MN_NONE;
    fork->fork.bound[0] = fork->fork.bound[1] = nothing;
    while (more != MN_NONE) {
        const mni_front_chunk list = f->chunk[more];
        mni_chunk_free(f, more);
        more = list.next;
        for (int i = 0; i < MNI_FRONT_CHUNK && list.corner[i] != 0; i++) {
            const mni_pole_bound its = bound_of(f, list.corner[i]);
            const uint32_t k = hash_of(list.corner[i]) << depth >> 31;
            put(f, &fork->fork.part[k], &fork->fork.bound[k], list.corner[i], &its, depth + 1);
        }
    }
}

static void put(mni_front *f, uint32_t *part, mni_pole_bound *bound, uint32_t corner,
                const mni_pole_bound *its, uint32_t depth) {
    for (;; depth++) {
        add(bound, its);
        if (!is_fork(*part)) {
            const bool full = *part != MN_NONE && f->chunk[*part].corner[MNI_FRONT_CHUNK - 1] != 0;
            if (!full || mni_packed_chunks(f, *part) < FORK_CHUNKS || depth == DEPTH_MAX ||
                !has_spare(f)) {
                mni_packed_push(f, part, corner);
                return;
            }
            divide(f, part, depth);
        }
        mni_front_chunk *fork = fork_at(f, *part);
        const uint32_t k = hash_of(corner) << depth >> 31;
        bound = &fork->fork.bound[k];
        part = &fork->fork.part[k];
    }
}

/* A fork of two short lists becomes one. */
static void merge(mni_front *f, uint32_t *part) {
    const uint32_t chunk = *part & ~FORK;
    const mni_front_chunk fork = f->chunk[chunk];
    uint32_t list = fork.fork.part[0], more = fork.fork.part[1];
    if (is_fork(list) || is_fork(more) ||
        mni_packed_chunks(f, list) + mni_packed_chunks(f, more) > MERGE_CHUNKS)
        return;
    mni_chunk_free(f, chunk);
    while (more != MN_NONE) {
        const mni_front_chunk from = f->chunk[more];
        mni_chunk_free(f, more);
        more = from.next;
        for (int i = 0; i < MNI_FRONT_CHUNK && from.corner[i] != 0; i++)
            mni_packed_push(f, &list, from.corner[i]);
    }
    *part = list;
}

/* No list has more chunks than FORK_CHUNKS, but where chunks were few. */
static void take_out(mni_front *f, uint32_t *part, uint32_t corner, uint32_t hash) {
    if (is_fork(*part)) {
        take_out(f, &fork_at(f, *part)->fork.part[hash >> 31], corner, hash << 1);
        merge(f, part);
        return;
    }
    for (uint32_t i = *part; i != MN_NONE; i = f->chunk[i].next)
        for (int k = 0; k < MNI_FRONT_CHUNK; k++) {
            mni_front_looks(f, 1);
            if (f->chunk[i].corner[k] == corner) {
                mni_packed_remove(f, part, &f->chunk[i].corner[k]);
                return;
            }
        }
    MN_ASSERT(!"a pole's corner");
}

static uint32_t pop(mni_front *f, uint32_t *part, mni_pole_bound *bound, uint32_t mid) {
    if (*part == MN_NONE || bound->leaf < mid)
        return 0;
    if (is_fork(*part)) {
        mni_front_chunk *fork = fork_at(f, *part);
        uint32_t corner = pop(f, &fork->fork.part[0], &fork->fork.bound[0], mid);
        if (corner == 0)
            corner = pop(f, &fork->fork.part[1], &fork->fork.bound[1], mid);
        *bound = both(fork);
        if (corner != 0)
            merge(f, part);
        return corner;
    }
    uint32_t largest = 0;
    for (uint32_t i = *part; i != MN_NONE; i = f->chunk[i].next)
        for (int k = 0; k < MNI_FRONT_CHUNK && f->chunk[i].corner[k] != 0; k++) {
            mni_front_looks(f, 1);
            const uint32_t corner = f->chunk[i].corner[k];
            const uint32_t leaf = f->simplex_leaf[mni_corner_at(corner)];
            if (leaf >= mid) {
                mni_packed_remove(f, part, &f->chunk[i].corner[k]);
                return corner;
            }
            largest = leaf > largest ? leaf : largest;
        }
    bound->leaf = largest;
    return 0;
}

/* ---- what moves beside a pole -----------------------------------------------------------------
 */

static void tell_pole(const mni_front *f, uint32_t slot, uint32_t corner,
                      const mni_pole_bound *its) {
    mni_front_chunk *p = of(f, slot);
    uint32_t part = p->pole.tree, hash = hash_of(corner);
    add(&p->pole.bound, its);
    for (; is_fork(part); hash <<= 1) {
        mni_front_chunk *fork = fork_at(f, part);
        add(&fork->fork.bound[hash >> 31], its);
        part = fork->fork.part[hash >> 31];
    }
}

/* The poles at a corner of a node that is none. */
static void tell_corner(const mni_front *f, uint32_t slot, uint32_t corner) {
    const mni_pole_bound its = {0, f->node[slot].order, f->node[slot].above};
    for (int k = 0; k < 2; k++) {
        const uint32_t at = beside(f, corner, k);
        if (mni_front_is_pole(&f->node[at]))
            tell_pole(f, at, k ? mni_corner_before(corner) : mni_corner_after(corner), &its);
    }
}

/* ---- poles ----------------------------------------------------------------------------------- */

void mni_pole_make(mni_front *f, uint32_t slot) {
    uint32_t taken = 0;
    for (uint32_t i = f->poles; i != MN_NONE; i = f->chunk[i].pole.next)
        taken |= 1u << f->chunk[i].pole.number;
    if (!has_spare(f) || taken == UINT32_MAX)
        return;
    const uint32_t chunk = mni_chunk_new(f);
    mni_loose list = mni_corners_take(f, slot);
    mni_front_chunk *made = &f->chunk[chunk];
    made->pole.slot = slot;
    made->pole.next = f->poles;
    made->pole.number = (uint32_t)__builtin_ctz(~taken);
    made->pole.near = 0;
    made->pole.witness = 0;
    made->pole.tree = MN_NONE;
    made->pole.bound = nothing;
    f->poles = chunk;
    f->node[slot].more = chunk | MNI_FRONT_POLE;
    do {
        for (int i = 0; i < MNI_FRONT_CORNERS && list.corner[i] != 0; i++)
            mni_corners_push(f, slot, list.corner[i]);
    } while (mni_corners_next(f, &list));
}

static void plain_push(mni_front *f, uint32_t slot, uint32_t corner) {
    if (f->node[slot].more - MNI_FRONT_SHORT < MNI_FRONT_CORNERS)
        mni_corners_push(f, slot, corner);
    else
        (void)mni_corners_push_chunk(f, slot, corner);
}

/* Each chunk is given back before its corners are pushed, so that it takes none that is not there.
 */
static void drain(mni_front *f, uint32_t part, uint32_t slot) {
    if (is_fork(part)) {
        const mni_front_chunk fork = *fork_at(f, part);
        mni_chunk_free(f, part & ~FORK);
        drain(f, fork.fork.part[0], slot);
        drain(f, fork.fork.part[1], slot);
        return;
    }
    while (part != MN_NONE) {
        const mni_front_chunk list = f->chunk[part];
        mni_chunk_free(f, part);
        part = list.next;
        for (int i = 0; i < MNI_FRONT_CHUNK && list.corner[i] != 0; i++)
            plain_push(f, slot, list.corner[i]);
    }
}

void mni_pole_unmake(mni_front *f, uint32_t slot) {
    const uint32_t chunk = f->node[slot].more & ~MNI_FRONT_POLE;
    const mni_front_chunk gone = f->chunk[chunk];
    uint32_t *at = &f->poles;
    for (; *at != chunk; at = &f->chunk[*at].pole.next)
        f->chunk[*at].pole.near &= ~(1u << gone.pole.number);
    *at = gone.pole.next;
    for (uint32_t i = *at; i != MN_NONE; i = f->chunk[i].pole.next)
        f->chunk[i].pole.near &= ~(1u << gone.pole.number);
    mni_chunk_free(f, chunk);
    mni_corners_clear(f, slot);
    drain(f, gone.pole.tree, slot);
    mni_poles_tell(f, slot);
}

void mni_poles_give_way(mni_front *f) {
    if (f->poles != MN_NONE)
        mni_pole_unmake(f, f->chunk[f->poles].pole.slot);
}

static void unmake_small(mni_front *f, uint32_t slot) {
    const mni_front_chunk *p = of(f, slot);
    if (!is_fork(p->pole.tree) && mni_packed_chunks(f, p->pole.tree) <= MERGE_CHUNKS)
        mni_pole_unmake(f, slot);
}

void mni_pole_push(mni_front *f, uint32_t slot, uint32_t corner) {
    if (mni_chunks_left(f) < 2) {
        mni_pole_unmake(f, slot);
        plain_push(f, slot, corner);
        tell_corner(f, slot, corner); /* another pole there may have left it out, as one */
        return;
    }
    mni_front_chunk *p = of(f, slot);
    for (int k = 0; k < 2; k++) {
        const mni_front_node *n = &f->node[beside(f, corner, k)];
        if (!mni_front_is_pole(n))
            continue;
        mni_front_chunk *other = &f->chunk[n->more & ~MNI_FRONT_POLE];
        p->pole.near |= 1u << other->pole.number;
        other->pole.near |= 1u << p->pole.number;
    }
    const mni_pole_bound its = bound_of(f, corner);
    put(f, &p->pole.tree, &p->pole.bound, corner, &its, 0);
}

void mni_pole_remove(mni_front *f, uint32_t slot, uint32_t corner) {
    take_out(f, &of(f, slot)->pole.tree, corner, hash_of(corner));
    unmake_small(f, slot);
}

uint32_t mni_pole_pop(mni_front *f, uint32_t slot, uint32_t mid) {
    mni_front_chunk *p = of(f, slot);
    const uint32_t corner = pop(f, &p->pole.tree, &p->pole.bound, mid);
    if (corner != 0)
        unmake_small(f, slot);
    return corner;
}

/* ---- neighbours ------------------------------------------------------------------------------ */

typedef struct search {
    uint32_t order, above;
    mni_front_ref *out;
    uint32_t room, count;
} search;

static bool fits(const search *s, uint32_t order, uint32_t above) {
    return order > s->order || above < s->above;
}

/* All that fit as far as room goes; where none was left out the bound becomes the best. */
static void seek(mni_front *f, uint32_t part, mni_pole_bound *bound, search *s) {
    if (part == MN_NONE || !fits(s, bound->order, bound->above))
        return;
    mni_pole_bound best = nothing;
    best.leaf = bound->leaf;
    if (is_fork(part)) {
        mni_front_chunk *fork = fork_at(f, part);
        for (int k = 0; k < 2 && s->count < s->room; k++)
            seek(f, fork->fork.part[k], &fork->fork.bound[k], s);
        *bound = both(fork);
        return;
    }
    for (uint32_t i = part; i != MN_NONE; i = f->chunk[i].next)
        for (int j = 0; j < MNI_FRONT_CHUNK && f->chunk[i].corner[j] != 0; j++) {
            mni_front_looks(f, 1);
            for (int k = 0; k < 2; k++) {
                const uint32_t at = beside(f, f->chunk[i].corner[j], k);
                const mni_front_node *n = &f->node[at];
                if (mni_front_is_pole(n))
                    continue;
                if (fits(s, n->order, n->above)) {
                    s->out[s->count++] = mni_front_ref_of(f, at);
                    if (s->count == s->room)
                        return;
                }
            }
            add_neighbours(f, f->chunk[i].corner[j], &best);
        }
    *bound = best;
}

static uint32_t corner_beside(mni_front *f, uint32_t part, uint32_t other) {
    uint32_t found = 0;
    if (is_fork(part)) {
        for (int k = 0; k < 2 && found == 0; k++)
            found = corner_beside(f, fork_at(f, part)->fork.part[k], other);
        return found;
    }
    for (uint32_t i = part; i != MN_NONE; i = f->chunk[i].next)
        for (int j = 0; j < MNI_FRONT_CHUNK && f->chunk[i].corner[j] != 0; j++) {
            mni_front_looks(f, 1);
            const uint32_t corner = f->chunk[i].corner[j];
            if (beside(f, corner, 0) == other || beside(f, corner, 1) == other)
                return corner;
        }
    return 0;
}

/* Does a simplex join the two poles? One that did is looked at first. */
static bool are_neighbours(mni_front *f, mni_front_chunk *p, const mni_front_chunk *other) {
    const uint32_t corner = p->pole.witness, slot = other->pole.slot;
    if (mni_corner_slot(f, corner) == p->pole.slot &&
        (beside(f, corner, 0) == slot || beside(f, corner, 1) == slot))
        return true;
    const uint32_t found = corner_beside(f, p->pole.tree, slot);
    if (found != 0)
        p->pole.witness = found;
    else
        p->pole.near &= ~(1u << other->pole.number);
    return found != 0;
}

static bool is_near(const mni_front_chunk *p, const mni_front_chunk *other) {
    return (p->pole.near >> other->pole.number & 1) != 0;
}

uint32_t mni_pole_seek(mni_front *f, uint32_t slot, uint32_t order, uint32_t above,
                       mni_front_ref *out, uint32_t room) {
    mni_front_chunk *p = of(f, slot);
    search s = {order, above, out, room, 0};
    for (uint32_t i = f->poles; i != MN_NONE && s.count < room; i = f->chunk[i].pole.next) {
        const mni_front_chunk *other = &f->chunk[i];
        const mni_front_node *n = &f->node[other->pole.slot];
        if (is_near(p, other) && fits(&s, n->order, n->above) && are_neighbours(f, p, other))
            out[s.count++] = mni_front_ref_of(f, other->pole.slot);
    }
    if (s.count < room)
        seek(f, p->pole.tree, &p->pole.bound, &s);
    return s.count;
}

uint32_t mni_pole_find(const mni_front *f, uint32_t slot, uint32_t leaf) {
    const mni_front_chunk *p = of(f, slot);
    for (uint32_t i = f->poles; i != MN_NONE; i = f->chunk[i].pole.next) {
        const mni_front_node *n = &f->node[f->chunk[i].pole.slot];
        if (is_near(p, &f->chunk[i]) && leaf - n->leaf_lo < n->leaf_hi - n->leaf_lo)
            return f->chunk[i].pole.slot;
    }
    return MN_NONE;
}

void mni_poles_tell(mni_front *f, uint32_t slot) {
    if (mni_front_is_pole(&f->node[slot]))
        return;
    for (mni_run r = mni_run_first(f, slot); r.corner != NULL; r = mni_run_next(f, r))
        for (uint32_t i = 0; i < r.room && r.corner[i] != 0; i++)
            tell_corner(f, slot, r.corner[i]);
}

/* ---- checks ---------------------------------------------------------------------------------- */

static uint64_t check_part(const mni_front *f, uint32_t slot, uint32_t part,
                           const mni_pole_bound *bound, uint32_t path, uint32_t depth) {
    uint64_t count = 0;
    if (is_fork(part)) {
        const mni_front_chunk *fork = fork_at(f, part);
        for (uint32_t k = 0; k < 2; k++) {
            const mni_pole_bound *b = &fork->fork.bound[k];
            MN_ASSERT(b->leaf <= bound->leaf && b->order <= bound->order &&
                      b->above >= bound->above);
            count += check_part(f, slot, fork->fork.part[k], b, 2 * path + k, depth + 1);
        }
        return count;
    }
    for (uint32_t i = part; i != MN_NONE; i = f->chunk[i].next) {
        const uint32_t corners = mni_chunk_corners(&f->chunk[i]);
        MN_ASSERT(i == part ? corners > 0 : corners == MNI_FRONT_CHUNK);
        for (uint32_t j = 0; j < corners; j++) {
            const uint32_t corner = f->chunk[i].corner[j];
            const mni_pole_bound its = bound_of(f, corner);
            MN_ASSERT(mni_corner_slot(f, corner) == slot);
            MN_ASSERT(depth == 0 || hash_of(corner) >> (32 - depth) == path);
            MN_ASSERT(its.leaf <= bound->leaf && its.order <= bound->order &&
                      its.above >= bound->above);
            for (int k = 0; k < 2; k++) {
                const mni_front_node *n = &f->node[beside(f, corner, k)];
                MN_ASSERT(!mni_front_is_pole(n) ||
                          is_near(of(f, slot), &f->chunk[n->more & ~MNI_FRONT_POLE]));
            }
        }
        count += corners;
    }
    return count;
}

uint64_t mni_pole_check(const mni_front *f, uint32_t slot) {
    const mni_front_chunk *p = of(f, slot);
    bool listed = false;
    for (uint32_t i = f->poles; i != MN_NONE; i = f->chunk[i].pole.next)
        listed |= &f->chunk[i] == p;
    MN_ASSERT(listed && p->pole.slot == slot && p->pole.number < MNI_POLES);
    MN_ASSERT(f->node[slot].corner[0] == 0);
    return check_part(f, slot, p->pole.tree, &p->pole.bound, 0, 0);
}
