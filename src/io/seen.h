/* Blocks whose bytes have been looked at and found sound: come again as they were, they need no
 * second look.
 *
 * A block is known by its place and a digest of its bytes, in two steps under keys that are drawn
 * at random for the session and never shown. Each piece of 1 KiB becomes 128 bits by products of
 * its halves of words with a key added (NH, of UMAC, RFC 4418, twice with the key moved by a word):
 * two different pieces become the same under a share of 2^-64 of all keys. These bits, place and
 * length are the coefficients of a polynomial modulo 2^61 - 1, taken at a secret point: two
 * different ones agree at a share of at most (3 pieces + 2) / 2^61 of all points. So whoever writes
 * to the file while it is read, and knows all but the keys, passes no bytes unseen but by a chance
 * of 2^-56 for 8 KiB. Bytes at first sight are never known.
 *
 * Threads: one (I/O). Memory: 8 bytes an entry, from the arena. Eight entries are a line, for the
 * blocks that fall on it: of more than eight it forgets the one that it has known for longest. */
#ifndef MNI_SEEN_H
#define MNI_SEEN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"
#include "metanode/format.h"

enum { MNI_SEEN_PIECE = 128 }; /* words of 8 bytes */

typedef struct mni_seen {
    uint64_t *digest; /* by line; 0: none */
    uint32_t shift;
    uint64_t point; /* 0: no random numbers here, so nothing is ever known */
    uint64_t key[MNI_SEEN_PIECE + 1];
} mni_seen;

/* entries_max: a power of two is made of it, at least 16. */
size_t mni_seen_need(uint32_t entries_max);
void mni_seen_open(mni_seen *seen, uint32_t entries_max, mni_arena *arena);
/* Of bytes [0, ref.pages × 4096) that came from ref's place; above 0. */
uint64_t mni_seen_digest(const mni_seen *seen, mn_block_ref ref, const void *bytes);
bool mni_seen_has(const mni_seen *seen, mn_block_ref ref, uint64_t digest);
void mni_seen_add(mni_seen *seen, mn_block_ref ref, uint64_t digest);

#endif
