/* See walk.h. Asserts with MN_ASSERT, so that a failure names its line whatever the suite. */
#include "walk.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "mn_assert.h"

uint64_t mix(uint64_t a, uint64_t b) {
    uint64_t z = a * UINT64_C(0x9e3779b97f4a7c15) + b + UINT64_C(0x632be59bd9b4e019);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

uint64_t seed_of_test(uint64_t given) {
    const char *text = getenv("MN_SEED");
    uint64_t seed = text != NULL ? strtoull(text, NULL, 10) : given;
    printf("MN_SEED=%llu\n", (unsigned long long)seed);
    return seed;
}

static void *zeroed(size_t count, size_t size) {
    void *memory = calloc(count > 0 ? count : 1, size);
    MN_ASSERT(memory != NULL);
    return memory;
}

/* ---- the made file --------------------------------------------------------------------------- */

static uint32_t add_block(made_file *f, const made_desc *d, uint32_t parent, uint64_t dice) {
    uint32_t b = f->blocks++;
    uint32_t id = b == 0 ? 1 : f->block[b - 1].ref.id + f->block[b - 1].ref.pages;
    f->block[b] = (made_block){.ref = {.id = id, .pages = 1 + (uint32_t)(dice % d->pages_max)},
                               .parent = parent,
                               .depth = parent == MN_NONE ? 1 : f->block[parent].depth + 1,
                               .overflow_of = MN_NONE};
    return b;
}

static uint32_t add_subtree(made_file *f, uint32_t block, uint32_t parent, uint64_t dice) {
    uint32_t s = f->subtrees++;
    f->subtree[s] = (made_subtree){.block = block, .parent = parent, .own = (uint32_t)(dice % 3)};
    return s;
}

/* Breadth first: the children of a subtree in blocks of their own (levels), or several to a block
 * that belongs to the parent's block (packed). */
static void grow(made_file *f, const made_desc *d) {
    uint32_t blocks_max = d->blocks;
    for (uint32_t s = 0; s < f->subtrees; s++) {
        uint32_t block = f->subtree[s].block;
        uint64_t dice = mix(d->seed, 1000 + s);
        uint32_t want = d->regular ? d->fanout_max : 1 + (uint32_t)(dice % d->fanout_max);
        f->subtree[s].first_child = f->subtrees;
        if (f->block[block].depth >= d->depth_max)
            want = 0;
        uint32_t into = MN_NONE;
        for (uint32_t c = 0; c < want; c++) {
            uint64_t die = mix(dice, c);
            bool fresh =
                into == MN_NONE || d->regular || d->blocking == MN_BLOCKING_LEVELS || die % 3 == 0;
            if (fresh && f->blocks >= blocks_max)
                break;
            if (fresh)
                into = add_block(f, d, block, die >> 8);
            add_subtree(f, into, s, die >> 16);
            f->subtree[s].children++;
        }
        if (f->subtree[s].children + f->subtree[s].own == 0)
            f->subtree[s].own = 1;
    }
}

static void add_overflows(made_file *f, const made_desc *d) {
    for (uint32_t s = 0; d->overflow_max > 0 && s < f->subtrees; s++) {
        uint64_t dice = mix(d->seed, 5000000 + s);
        if (dice % 4 != 0)
            continue;
        uint32_t parent = f->subtree[s].block;
        f->subtree[s].overflow = 1 + (uint32_t)((dice >> 8) % d->overflow_max);
        for (uint32_t i = 0; i < f->subtree[s].overflow; i++) {
            parent = add_block(f, d, parent, dice >> (16 + i));
            f->block[parent].overflow_of = s;
        }
    }
}

static uint32_t block_refs(const made_file *f, uint32_t b, mn_block_ref *out) {
    uint32_t count = 0;
    for (uint32_t c = 0; c < f->blocks; c++)
        if (f->block[c].parent == b)
            out[count++] = f->block[c].ref;
    return count;
}

static void write_block(const made_file *f, uint32_t b, int fd, unsigned char *bytes,
                        mn_block_ref *refs) {
    const made_block *block = &f->block[b];
    size_t length = (size_t)block->ref.pages * MN_PAGE_BYTES;
    uint32_t count = block_refs(f, b, refs);
    uint32_t at = mni_frame_payload_at(count);
    MN_ASSERT(at + 8 <= length);
    for (size_t i = 0; i < length; i += 8) {
        uint64_t word = mix(block->ref.id, i);
        memcpy(bytes + i, &word, 8);
    }
    for (uint32_t i = 0; i < count; i++)
        mni_frame_set_ref(bytes, i, refs[i]);
    mni_frame frame = {.kind =
                           block->overflow_of == MN_NONE ? MNI_FRAME_METANODE : MNI_FRAME_OVERFLOW,
                       .refs = count,
                       .payload_bytes = (uint32_t)length,
                       .parent_id = block->parent == MN_NONE ? 0 : f->block[block->parent].ref.id};
    mni_frame_seal(bytes, &frame, block->ref, f->header.build_id);
    MN_ASSERT(mni_frame_check(bytes, block->ref, f->header.build_id, f->header.file_bytes) ==
              MNI_FRAME_OK);
    MN_ASSERT(pwrite(fd, bytes, length, (off_t)block->ref.id * MN_PAGE_BYTES) == (ssize_t)length);
}

static void fill_header(made_file *f, const made_desc *d) {
    mn_header *h = &f->header;
    const made_block *last = &f->block[f->blocks - 1];
    *h = (mn_header){.build_id = mix(d->seed, 77),
                     .file_bytes = ((uint64_t)last->ref.id + last->ref.pages) * MN_PAGE_BYTES,
                     .blocking = d->blocking,
                     .blocks = f->blocks,
                     .overflow_max = d->overflow_max,
                     .roots = d->roots > 0 ? d->roots : 1};
    for (uint32_t b = 0; b < f->blocks; b++) {
        uint32_t bytes = f->block[b].ref.pages * MN_PAGE_BYTES;
        h->block_bytes_max = bytes > h->block_bytes_max ? bytes : h->block_bytes_max;
        if (f->block[b].overflow_of == MN_NONE && f->block[b].depth > h->block_depth)
            h->block_depth = f->block[b].depth;
    }
    for (uint32_t r = 0; r < h->roots; r++)
        h->root[r] = (mn_root){.block = f->block[f->subtree[r].block].ref};
}

void made_file_make(made_file *f, const made_desc *d) {
    memset(f, 0, sizeof *f);
    uint32_t roots = d->roots > 0 ? d->roots : 1;
    uint32_t subtrees_max = roots + d->blocks * (d->fanout_max + 1) * 4;
    f->block = zeroed(roots + d->blocks + subtrees_max * d->overflow_max, sizeof *f->block);
    f->subtree = zeroed(subtrees_max * 4, sizeof *f->subtree);
    for (uint32_t r = 0; r < roots; r++)
        add_subtree(f, add_block(f, d, MN_NONE, mix(d->seed, r)), MN_NONE, mix(d->seed, 9 + r));
    grow(f, d);
    add_overflows(f, d);
    fill_header(f, d);

    const char *directory = getenv("TMPDIR");
    snprintf(f->path, sizeof f->path, "%.40s/mn-walk-XXXXXX", directory ? directory : "/tmp");
    int fd = mkstemp(f->path);
    MN_ASSERT(fd >= 0);
    unsigned char *bytes = zeroed(f->header.block_bytes_max, 1);
    mn_block_ref *refs = zeroed(f->blocks, sizeof *refs);
    MN_ASSERT(ftruncate(fd, (off_t)f->header.file_bytes) == 0);
    for (uint32_t b = 0; b < f->blocks; b++)
        write_block(f, b, fd, bytes, refs);
    free(refs);
    free(bytes);
    close(fd);
}

void made_file_damage(const made_file *f, uint32_t block) {
    int fd = open(f->path, O_RDWR);
    unsigned char byte;
    off_t at = (off_t)f->block[block].ref.id * MN_PAGE_BYTES + 1000;
    MN_ASSERT(fd >= 0 && pread(fd, &byte, 1, at) == 1);
    byte ^= 4;
    MN_ASSERT(pwrite(fd, &byte, 1, at) == 1);
    close(fd);
}

void made_file_free(made_file *f) {
    unlink(f->path);
    free(f->block);
    free(f->subtree);
    memset(f, 0, sizeof *f);
}

bool made_check(const void *context, const void *bytes, uint32_t length_bytes) {
    (void)context;
    uint64_t last;
    memcpy(&last, (const unsigned char *)bytes + length_bytes - 8, 8);
    uint32_t id;
    memcpy(&id, (const unsigned char *)bytes + 24, 4);
    return last == mix(id, length_bytes - 8);
}

void made_rate(const void *context, const void *look, const void *bytes, const mni_notes *notes,
               float least, float *urgency, mni_notes *below) {
    uint64_t camera;
    mni_frame frame;
    (void)context;
    memcpy(&camera, look, sizeof camera);
    mni_frame_get(bytes, &frame);
    uint32_t id;
    memcpy(&id, (const unsigned char *)bytes + 24, sizeof id);
    for (uint32_t i = 0; i < notes->count; i++)
        MN_ASSERT(notes->note[i].word[0] == id); /* they are of this block */
    for (uint32_t i = 0; i < frame.refs; i++) {
        mni_note note = {.word = {mni_frame_ref(bytes, i).id}};
        urgency[i] = (float)(mix(camera, note.word[0]) % 100) / 60;
        urgency[i] = urgency[i] < least ? 0 : urgency[i];
        below[i].count = 0;
        mni_notes_add(&below[i], &note);
    }
}

/* ---- the walker: opening --------------------------------------------------------------------- */

bool walker_open(walker *w, made_file *file, mni_store_desc desc) {
    memset(w, 0, sizeof *w);
    w->file = file;
    w->check_each_frame = true;
    desc.path = file->path;
    desc.header = &file->header;
    desc.check = made_check;
    desc.rate = made_rate;
    desc.look_bytes = sizeof w->camera;
    w->foresees = desc.prefetch == MN_PREFETCH_AHEAD;
    size_t need = mni_store_need_bytes(&file->header, desc.kind, desc.k);
    MN_ASSERT(mni_arena_open(&w->arena, need, &w->status) == MN_OK);
    if (mni_store_open(&desc, &w->arena, &w->store, &w->status) != MN_OK) {
        mni_arena_close(&w->arena);
        return false;
    }
    mni_arena_seal(&w->arena);
    uint32_t entries = mni_store_entries_max(&file->header, desc.kind, desc.k);
    w->state = zeroed(file->subtrees, 1);
    w->want = zeroed(file->subtrees, 1);
    w->given_up = zeroed(file->subtrees, sizeof *w->given_up);
    w->entry = zeroed(file->blocks, sizeof *w->entry);
    w->owner = zeroed(entries, sizeof *w->owner);
    w->recount = zeroed(file->blocks, sizeof *w->recount);
    for (uint32_t r = 0; r < file->header.roots; r++) {
        uint32_t block = file->subtree[r].block;
        w->entry[block] = mni_store_root(w->store, r);
        w->owner[w->entry[block]] = block;
        w->state[r] = 1;
    }
    return true;
}

void walker_close(walker *w) {
    mni_store_close(w->store);
    mni_arena_close(&w->arena);
    free(w->state);
    free(w->want);
    free(w->given_up);
    free(w->entry);
    free(w->owner);
    free(w->recount);
}

/* ---- the walker: checks ---------------------------------------------------------------------- */

static uint32_t nodes_of(const walker *w, uint32_t s) {
    const made_subtree *subtree = &w->file->subtree[s];
    if (w->state[s] < 2)
        return w->state[s];
    uint32_t nodes = subtree->own;
    for (uint32_t c = 0; c < subtree->children; c++)
        nodes += w->state[subtree->first_child + c] == 0;
    return nodes;
}

static uint32_t usage_of(void *context, mni_entry entry) {
    walker *w = context;
    return w->recount[w->owner[entry]];
}

static void check_bytes(walker *w, uint32_t block) {
    bool fresh;
    const void *bytes = mni_store_bytes(w->store, w->entry[block], &fresh);
    const mn_header *header = &w->file->header;
    MN_ASSERT(mni_frame_check(bytes, w->file->block[block].ref, header->build_id,
                              header->file_bytes) == MNI_FRAME_OK);
}

void walker_check(walker *w) {
    memset(w->recount, 0, w->file->blocks * sizeof *w->recount);
    for (uint32_t s = 0; s < w->file->subtrees; s++)
        w->recount[w->file->subtree[s].block] += nodes_of(w, s);
    mni_store_check_all(w->store, usage_of, w);
    for (uint32_t b = 0; b < w->file->blocks; b++)
        if (w->recount[b] > 0)
            check_bytes(w, b);
}

/* ---- the walker: switches -------------------------------------------------------------------- */

static mni_answer take_down(walker *w, uint32_t s) {
    const made_subtree *subtree = &w->file->subtree[s];
    uint32_t above = w->file->subtree[subtree->parent].block;
    mni_entry entry;
    mni_answer answer =
        mni_store_down(w->store, w->entry[above], w->file->block[subtree->block].ref, &entry);
    if (answer == MNI_ABSENT) {
        mn_block_ref ref = w->file->block[subtree->block].ref;
        mni_store_note(w->store, ref, &(mni_note){.word = {ref.id}});
    }
    if (answer == MNI_GRANTED) {
        w->entry[subtree->block] = entry;
        w->owner[entry] = subtree->block;
        check_bytes(w, subtree->block);
    }
    return answer;
}

static mni_answer take_overflow(walker *w, uint32_t s) {
    const made_file *f = w->file;
    uint32_t left = f->subtree[s].overflow;
    for (uint32_t b = 0; b < f->blocks && left > 0; b++) {
        const void *bytes;
        if (f->block[b].overflow_of != s)
            continue;
        mni_answer answer =
            mni_store_overflow(w->store, w->entry[f->subtree[s].block], f->block[b].ref, &bytes);
        if (answer != MNI_GRANTED)
            return answer;
        MN_ASSERT(mni_frame_check(bytes, f->block[b].ref, f->header.build_id,
                                  f->header.file_bytes) == MNI_FRAME_OK);
        left--;
    }
    return MNI_GRANTED;
}

/* A chain: `s`, and its neighbours of the same parent that are wanted too, and, where it is to be
 * opened, a child of each: all or nothing. The parents' nodes stay until it is carried out. */
static mni_answer split_chain(walker *w, uint32_t s, uint64_t dice) {
    enum { CHAIN_MAX = 6 };
    uint32_t chain[CHAIN_MAX], count = 0;
    const made_subtree *parent = &w->file->subtree[w->file->subtree[s].parent];
    uint32_t end = parent->first_child + parent->children;
    mni_answer answer = MNI_GRANTED;
    for (uint32_t t = s; t < end && count < 1 + dice % 3 && answer == MNI_GRANTED; t++) {
        if (w->want[t] == 0 || w->state[t] != 0)
            continue;
        answer = take_down(w, t);
        if (answer == MNI_GRANTED)
            chain[count++] = t;
    }
    uint32_t below = w->file->subtree[s].first_child;
    bool deeper = answer == MNI_GRANTED && dice >> 8 & 1 && w->want[s] == 2 &&
                  w->file->subtree[s].children > 0 && w->want[below] > 0;
    if (deeper && w->file->subtree[s].overflow > 0)
        answer = take_overflow(w, s);
    if (deeper && answer == MNI_GRANTED) {
        answer = take_down(w, below);
        if (answer == MNI_GRANTED)
            chain[count++] = below;
    }
    if (answer != MNI_GRANTED) {
        while (count > 0)
            mni_store_sub(w->store, w->entry[w->file->subtree[chain[--count]].block]);
        return answer;
    }
    for (uint32_t i = 0; i < count; i++) {
        uint32_t t = chain[i], above = w->file->subtree[t].parent;
        if (w->state[above] == 1) { /* the chain goes through it: open it */
            w->state[above] = 2;
            for (uint32_t n = nodes_of(w, above); n > 1; n--)
                mni_store_add(w->store, w->entry[w->file->subtree[above].block]);
        }
        w->state[t] = 1;
        mni_store_sub(w->store, w->entry[w->file->subtree[above].block]);
    }
    w->changes += count;
    return MNI_GRANTED;
}

static void open_subtree(walker *w, uint32_t s) {
    mni_answer answer = take_overflow(w, s);
    w->misses += answer == MNI_ABSENT;
    w->refused += answer == MNI_REFUSED;
    if (answer != MNI_GRANTED)
        return;
    mni_entry entry = w->entry[w->file->subtree[s].block];
    w->state[s] = 2;
    for (uint32_t n = nodes_of(w, s); n > 1; n--)
        mni_store_add(w->store, entry);
    w->changes++;
}

static void close_subtree(walker *w, uint32_t s) {
    mni_entry entry = w->entry[w->file->subtree[s].block];
    for (uint32_t n = nodes_of(w, s); n > 1; n--)
        mni_store_sub(w->store, entry);
    w->state[s] = 1;
    w->changes++;
}

static void take_up(walker *w, uint32_t s) {
    const made_subtree *subtree = &w->file->subtree[s];
    uint32_t above = w->file->subtree[subtree->parent].block;
    mni_answer answer = mni_store_up(w->store, w->entry[above]);
    MN_ASSERT(answer != MNI_REFUSED); /* the way up is never refused */
    w->misses += answer == MNI_ABSENT;
    if (answer != MNI_GRANTED)
        return;
    w->state[s] = 0;
    mni_store_sub(w->store, w->entry[subtree->block]);
    w->changes++;
}

/* ---- the walker: frames ---------------------------------------------------------------------- */

static void look(walker *w, uint64_t camera) {
    bool moved = w->moved = camera != w->camera;
    w->camera = camera;
    for (uint32_t s = 0; s < w->file->subtrees; s++) {
        const made_subtree *subtree = &w->file->subtree[s];
        uint64_t dice = mix(camera, s);
        bool root = subtree->parent == MN_NONE;
        bool may = camera != 0 && (root || w->want[subtree->parent] == 2);
        w->want[s] = root ? 1 : 0;
        if (may && (root || dice % 100 < 20 + camera % 75))
            w->want[s] = dice >> 32 & 3 ? 2 : 1;
        if (moved)
            w->given_up[s] = 0;
    }
}

static bool has_active_child(const walker *w, uint32_t s) {
    const made_subtree *subtree = &w->file->subtree[s];
    for (uint32_t c = 0; c < subtree->children; c++)
        if (w->state[subtree->first_child + c] != 0)
            return true;
    return false;
}

static void collapse_pass(walker *w) {
    for (uint32_t s = w->file->subtrees; s-- > 0;) {
        if (w->state[s] == 2 && w->want[s] < 2 && !has_active_child(w, s))
            close_subtree(w, s);
        if (w->state[s] == 1 && w->want[s] == 0)
            take_up(w, s);
        if (w->check_each_step)
            walker_check(w);
    }
}

/* Where places are scarce: what is there comes into use first, and what is not is sought. */
static void there_first(walker *w) {
    if (!w->foresees || !w->moved || w->camera % 2 == 0 || !mni_store_there_only(w->store, true))
        return;
    for (uint32_t s = 0; s < w->file->subtrees; s++) {
        const uint32_t parent = w->file->subtree[s].parent;
        if (w->state[s] != 0 || w->want[s] == 0 || w->state[parent] != 2)
            continue;
        if (split_chain(w, s, mix(w->camera + 1, s)) == MNI_REFUSED) {
            const mni_refusal refusal = mni_store_refusal(w->store, false);
            const mni_refusal alone = mni_store_refusal(w->store, true);
            MN_ASSERT(alone.block_id == refusal.block_id && alone.need <= refusal.need);
            if (!mni_store_has(w->store, &refusal))
                (void)mni_store_seek(w->store, &refusal);
        }
        if (w->check_each_step)
            walker_check(w);
    }
    (void)mni_store_there_only(w->store, false);
}

static void split_pass(walker *w) {
    uint64_t epoch = mni_store_epoch(w->store) + 1;
    for (uint32_t s = 0; s < w->file->subtrees; s++) {
        if (w->state[s] == 1 && w->want[s] == 2)
            open_subtree(w, s);
        uint32_t parent = w->file->subtree[s].parent;
        if (w->state[s] != 0 || w->want[s] == 0 || w->state[parent] != 2)
            continue;
        if (w->given_up[s] == epoch) {
            w->refused++;
            continue;
        }
        mni_answer answer = split_chain(w, s, mix(w->camera + 1, s));
        w->misses += answer == MNI_ABSENT;
        w->refused += answer == MNI_REFUSED;
        w->given_up[s] = answer == MNI_REFUSED ? epoch : 0;
        if (w->check_each_step)
            walker_check(w);
    }
}

/* A chain of one or two is taken early, and given back; or, of one, stays. */
static void take_early(walker *w, uint32_t s, uint32_t frames, bool stays) {
    const made_subtree *subtree = &w->file->subtree[s];
    mni_store_early(w->store, frames);
    const bool granted = take_down(w, s) == MNI_GRANTED;
    if (granted && stays) {
        w->state[s] = 1;
        mni_store_sub(w->store, w->entry[w->file->subtree[subtree->parent].block]);
        w->changes++;
    } else if (granted) {
        if (subtree->overflow > 0)
            (void)take_overflow(w, s);
        if (subtree->children > 0 && take_down(w, subtree->first_child) == MNI_GRANTED)
            mni_store_sub(w->store, w->entry[w->file->subtree[subtree->first_child].block]);
        mni_store_sub(w->store, w->entry[subtree->block]);
    }
    mni_store_attempt_over(w->store);
    mni_store_early(w->store, 0);
}

/* Where the next camera may go, right or wrong: below what is open, and back up. */
static void foresee(walker *w) {
    for (uint32_t s = 0; s < w->file->subtrees; s++) {
        const made_subtree *subtree = &w->file->subtree[s];
        uint64_t dice = mix(w->camera + 2, s);
        if (subtree->parent == MN_NONE || dice % 3 == 0)
            continue;
        uint32_t above = w->file->subtree[subtree->parent].block, frames = 1 + dice % 12;
        if (w->state[s] != 0)
            mni_store_ahead_up(w->store, w->entry[above], frames);
        else if (w->state[subtree->parent] != 2)
            continue;
        else if (dice >> 8 & 1)
            mni_store_ahead_down(w->store, w->entry[above], w->file->block[subtree->block].ref,
                                 frames);
        else
            take_early(w, s, frames, w->moved && dice >> 9 & 1);
        if (w->check_each_step)
            walker_check(w);
    }
}

void walker_frame(walker *w, uint64_t camera, double frame_s) {
    if (w->foresees)
        mni_store_look(w->store, &camera);
    w->misses = w->changes = w->refused = 0;
    mni_store_frame_begin(w->store);
    look(w, camera);
    collapse_pass(w);
    there_first(w);
    split_pass(w);
    if (w->foresees && w->moved)
        foresee(w);
    mni_store_frame_end(w->store, frame_s);
    if (w->check_each_frame)
        walker_check(w);
}

uint32_t walker_settle(walker *w, uint64_t camera, uint32_t frames_max) {
    for (uint32_t frame = 1; frame <= frames_max; frame++) {
        walker_frame(w, camera, 0.001);
        bool quiet = w->changes == 0 && mni_store_pending(w->store) == 0;
        mni_store_drain(w->store);
        if (quiet)
            return frame;
    }
    return frames_max;
}

bool walker_at_roots(const walker *w) {
    for (uint32_t s = 0; s < w->file->subtrees; s++)
        if (w->state[s] != (w->file->subtree[s].parent == MN_NONE))
            return false;
    return true;
}

bool walker_has_all(const walker *w) {
    for (uint32_t s = 0; s < w->file->subtrees; s++)
        if (w->state[s] != w->want[s])
            return false;
    return true;
}
