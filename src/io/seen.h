/* Blocks whose bytes have been looked at and found sound: come again as they were, they need no
 * second look.
 *
 * A block is known by its place and a digest of its bytes: a polynomial over the integers modulo
 * 2^61 - 1 at a point that is drawn at random for the session and never shown. Two different blocks
 * have one digest at a share of at most (length / 7 + 3) / 2^61 of all points (2^-50 for 8 KiB),
 * whatever their bytes: so whoever writes to the file while it is read, and knows all but the
 * point, passes no bytes unseen but by that chance. Bytes at first sight are never known.
 *
 * Threads: one (I/O). Memory: 8 bytes an entry, from the arena; blocks that share an entry forget
 * each other. */
#ifndef MNI_SEEN_H
#define MNI_SEEN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"
#include "metanode/format.h"

typedef struct mni_seen {
    uint64_t *digest; /* by place; 0: none */
    uint32_t shift;
    uint64_t point, point4; /* the point and its fourth power; 0: no random numbers here, so nothing
                               is ever known */
} mni_seen;

/* entries_max: a power of two is made of it, at least 16. */
size_t mni_seen_need(uint32_t entries_max);
void mni_seen_open(mni_seen *seen, uint32_t entries_max, mni_arena *arena);
/* Of bytes [0, ref.pages × 4096) that came from ref's place; above 0. */
uint64_t mni_seen_digest(const mni_seen *seen, mn_block_ref ref, const void *bytes);
bool mni_seen_has(const mni_seen *seen, mn_block_ref ref, uint64_t digest);
void mni_seen_add(mni_seen *seen, mn_block_ref ref, uint64_t digest);

#endif
