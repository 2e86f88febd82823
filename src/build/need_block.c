/* How much memory it takes to cut a tree on the disk into blocks: by the longest block that there
 * can be, before there is a tree.
 *
 *   packed   the packer's measures, and so many bytes for each of a block: its draft with what
 *            trials have looked at below it, lists of exits, a subtree's rows, the bytes themselves
 *   levels   so many for each node of a full block: two drafts with the exits, a run each
 *
 * To these come the pages of the tree that a thread keeps to itself. A thread beside the packer has
 * copies of three drafts: where the cap has no room for them there is none. All were measured, as
 * peaks of the process: models of 0.1 to 0.7 M vertices with and without colours, 8, 9 and 16 bits
 * a position, blocks of 4 KiB to 1 MiB, 10 to 16 levels. Memory: none. */
#include "need_block.h"

#include "block.h"
#include "block_press.h"
#include "cap.h"
#include "header.h"
#include "rows.h"
#include "simplify.h"

enum {
    MEASURES_BYTES = 3 << 19,
    PACKED_TIMES = 60, /* 35 to 57 were seen */
    PACKED_TIMES_THREAD = 66,
    PACKED_NODE_BYTES = 1200,  /* of a tree that fits a block: at most 930 */
    PACKED_NODE_THREAD = 1200, /* 980 */
    LEVELS_NODE_BYTES = 1700,  /* 1,600 where all that can be are exits */
    LEVELS_NODE_THREAD = 1050, /* 830 */
    NEAR_BYTES = 1 << 18,      /* a thread's own pages of the tree */
    THREAD_BYTES = (1 << 18) + NEAR_BYTES,
};

static uint64_t min_u64(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

uint64_t mni_tree_rows_bytes(uint64_t leaves, uint64_t simplices, bool has_colors) {
    const uint64_t tree =
        leaves * (12 /* positions */ + (has_colors ? 4 : 0) + 5 * 4 /* links, leaves */ +
                  8 /* values, radii */ + sizeof(mn_cone) + 4 /* simplices begin */) +
        simplices * 12;
    return tree + leaves * (sizeof(mni_row) + 4) + simplices * sizeof(mni_row_simplex);
}

uint64_t mni_block_work(const mn_block_desc *desc, uint64_t leaves, bool threaded) {
    if (desc->blocking == MN_BLOCKING_LEVELS) {
        const uint32_t l = desc->l != 0 ? desc->l : MNI_BLOCK_LEVELS;
        const uint32_t full = l < 16 ? (1u << l) - 1 : MNI_BLOCK_NODES_MAX;
        const uint64_t nodes = min_u64(full, leaves);
        return NEAR_BYTES + nodes * (LEVELS_NODE_BYTES + (threaded ? LEVELS_NODE_THREAD : 0)) +
               (threaded ? THREAD_BYTES : 0);
    }
    const uint64_t length = desc->block_bytes != 0 ? desc->block_bytes : MNI_BLOCK_BYTES;
    uint64_t bytes =
        MEASURES_BYTES + NEAR_BYTES + min_u64(PACKED_TIMES * length, PACKED_NODE_BYTES * leaves);
    if (threaded)
        bytes += THREAD_BYTES + min_u64(PACKED_TIMES_THREAD * length, PACKED_NODE_THREAD * leaves);
    return bytes;
}

bool mni_block_threaded(const mn_block_desc *desc, uint64_t leaves, uint64_t held_bytes) {
    return desc->threads > 1 &&
           (desc->ram_bytes == 0 ||
            MNI_PROGRAM_BYTES + held_bytes + mni_block_work(desc, leaves, true) <= desc->ram_bytes);
}

mn_code mn_block_fits(const char *in, const mn_block_desc *desc, uint64_t vertices,
                      uint64_t least_bytes, mn_status *st) {
    const bool packed = desc->blocking == MN_BLOCKING_PACKED;
    const uint32_t length = desc->block_bytes != 0 ? desc->block_bytes : MNI_BLOCK_BYTES;
    uint64_t need = MNI_PROGRAM_BYTES + mni_block_work(desc, vertices, false);
    if (desc->ram_bytes == 0)
        return MN_OK;
    if (packed && desc->zstd_level > 0 && mni_block_press_bytes(desc, length) > need)
        return mni_block_press_fits(in, desc, length, least_bytes, st);
    if (need <= desc->ram_bytes)
        return MN_OK;
    need = need > least_bytes ? need : least_bytes;
    const bool shorter = MNI_PROGRAM_BYTES + 2 * MEASURES_BYTES <= desc->ram_bytes; /* would do? */
    return mn_fail(st, MN_CAP_TOO_SMALL,
                   "%s: %.1f MB of memory are too few for its blocks: try --ram %lluM%s", in,
                   (double)desc->ram_bytes / (1 << 20), mni_megabytes(need),
                   !shorter ? ""
                   : packed ? ", or smaller --block-bytes"
                            : ", or a lower -L");
}
