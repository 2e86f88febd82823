/* The frame of a block: what makes damaged, misplaced and stale bytes known, and the table of the
 * blocks it refers to. No meaning beyond that: the pool, the I/O and the statistics see this much
 * of a block and no more, so that other kinds of blocks can join.
 *
 *   0  magic "MNBK"          u32
 *   4  kind                  u32   what the payload is: 1 meta-node, 2 overflow
 *   8  checksum              u64   XXH3-64 of bytes [16, length), its seed bytes [0, 8) as a u64
 *  16  build id              u64
 *  24  id                    u32   offset in the file / 4096
 *  28  pages                 u32   length / 4096
 *  32  refs                  u32   entries of the reference table
 *  36  payload bytes         u32   used bytes of the block, this frame included
 *  40  parent id             u32   0: a root block (block 0 is the header)
 *  44  zero                  u32
 *  48  refs × { id u32, pages u32 }: child blocks, each once, ids rising by table order not needed
 *  …   payload, from the next multiple of 8
 * All little-endian. Any thread; nothing blocks or allocates. */
#ifndef MNI_FRAME_H
#define MNI_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "metanode/format.h"

enum { MNI_FRAME_BYTES = 48, MNI_FRAME_MAGIC = 0x4b424e4d };
typedef enum mni_frame_kind { MNI_FRAME_METANODE = 1, MNI_FRAME_OVERFLOW = 2 } mni_frame_kind;

typedef struct mni_frame {
    uint32_t kind, refs, payload_bytes, parent_id;
} mni_frame;

typedef enum mni_frame_fault {
    MNI_FRAME_OK = 0,
    MNI_FRAME_BAD_MAGIC,
    MNI_FRAME_BAD_CHECKSUM,
    MNI_FRAME_WRONG_BUILD, /* stale: of another build of the file */
    MNI_FRAME_WRONG_PLACE, /* misplaced: says another id or length */
    MNI_FRAME_BAD_TABLE,   /* reference table or payload outside the block or the file */
} mni_frame_fault;

/* Checks bytes [0, ref.pages × 4096) against where they were read from. */
mni_frame_fault mni_frame_check(const void *bytes, mn_block_ref ref, uint64_t build_id,
                                uint64_t file_bytes);
const char *mni_frame_fault_text(mni_frame_fault fault);
/* The length that a block claims for itself: bytes [0, MNI_FRAME_BYTES), which nobody has checked.
 */
uint32_t mni_frame_pages(const void *bytes);
/* Of bytes that were checked. */
void mni_frame_get(const void *bytes, mni_frame *out);
mn_block_ref mni_frame_ref(const void *bytes, uint32_t index);
/* References that a block of that length can have at most. */
static inline uint32_t mni_frame_refs_max(uint32_t block_bytes) {
    return (block_bytes - MNI_FRAME_BYTES) / (uint32_t)sizeof(mn_block_ref);
}
/* Offset of the payload in a frame with that many references. */
uint32_t mni_frame_payload_at(uint32_t refs);
/* Writes the frame (references are in place already: see mni_frame_set_ref) and its checksum. */
void mni_frame_set_ref(void *bytes, uint32_t index, mn_block_ref ref);
void mni_frame_seal(void *bytes, const mni_frame *frame, mn_block_ref self, uint64_t build_id);

#endif
