/* See cap.h. Hidden here: what of that is the allocator's, and what the kernel's. */
#include "cap.h"

#include <malloc.h>

#include "host.h"
#include "metanode/build.h"

enum { MMAP_BYTES = 16 << 10 }; /* what takes more is given back as soon as it is freed */

void cap_keep(uint64_t ram_bytes) {
    /* What cells take comes and goes: a heap would keep it, and more with each cell. */
    mallopt(M_MMAP_THRESHOLD, MMAP_BYTES);
    mallopt(M_ARENA_MAX, 1);
    if (host_ram_bytes("") < 2 * ram_bytes)
        mn_readahead_off();
}
