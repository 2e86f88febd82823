/* Which numbers come often, of more than there is room to count: the heavy hitters of Misra and
 * Gries (1982).
 *
 * So many counters; a number without one takes a free one, or, if there is none, lowers all until
 * one is free. So what is counted of a number falls short by the weight of all divided by the
 * counters, at most, and none that came more often than that is lost. What is counted depends on
 * the numbers and their order alone. One thread. Memory: 32 to 64 bytes a counter,
 * taken at open. */
#ifndef MNI_HEAVY_H
#define MNI_HEAVY_H

#include <stdbool.h>
#include <stdint.h>

typedef struct mni_heavy_counter {
    uint32_t number;
    uint32_t count; /* 0: free */
} mni_heavy_counter;

typedef struct mni_heavy {
    mni_heavy_counter *counter, *scratch; /* hashed */
    uint32_t room, most, used;
} mni_heavy;

bool mni_heavy_open(mni_heavy *heavy, uint32_t counters); /* false: no memory */
void mni_heavy_close(mni_heavy *heavy);                   /* harmless on a closed one */
/* The number has come so often, at least once. */
void mni_heavy_add(mni_heavy *heavy, uint32_t number, uint32_t weight);
/* Those that are counted more often than `least`, in no order, the caller's to move, until more is
 * added. Returns how many. */
uint32_t mni_heavy_take(mni_heavy *heavy, uint32_t least, mni_heavy_counter **taken);

#endif
