/* The frame of a block: see frame.h for the bytes.
 *
 * Secret: where each field lies. Everything is read with memcpy, so that bytes from anywhere may be
 * looked at. Order: mni_frame_check first; the getters trust what it has seen. Any thread; owns
 * nothing. (design.md §3.5) */
#include "frame.h"

#include <string.h>
#include <xxhash.h>

#include "mn_assert.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little-endian");

enum {
    AT_MAGIC = 0,
    AT_KIND = 4,
    AT_CHECKSUM = 8,
    AT_BUILD_ID = 16, /* what the checksum covers begins here */
    AT_ID = 24,
    AT_PAGES = 28,
    AT_REFS = 32,
    AT_PAYLOAD_BYTES = 36,
    AT_PARENT_ID = 40,
    AT_ZERO = 44,
    REF_BYTES = 8,
};

static uint32_t get32(const void *bytes, size_t at) {
    uint32_t value;
    memcpy(&value, (const unsigned char *)bytes + at, sizeof value);
    return value;
}

static uint64_t get64(const void *bytes, size_t at) {
    uint64_t value;
    memcpy(&value, (const unsigned char *)bytes + at, sizeof value);
    return value;
}

static void put32(void *bytes, size_t at, uint32_t value) {
    memcpy((unsigned char *)bytes + at, &value, sizeof value);
}

static void put64(void *bytes, size_t at, uint64_t value) {
    memcpy((unsigned char *)bytes + at, &value, sizeof value);
}

static uint64_t checksum(const void *bytes, uint64_t length_bytes) {
    /* The seed is what stands before the checksum, so that it is covered as well. */
    return XXH3_64bits_withSeed((const unsigned char *)bytes + AT_BUILD_ID,
                                length_bytes - AT_BUILD_ID, get64(bytes, AT_MAGIC));
}

static bool table_is_sound(const void *bytes, uint64_t length_bytes, uint64_t file_bytes) {
    uint64_t pages_of_file = file_bytes / MN_PAGE_BYTES;
    uint32_t refs = get32(bytes, AT_REFS);
    uint64_t table_end = MNI_FRAME_BYTES + (uint64_t)refs * REF_BYTES;
    uint32_t payload_bytes = get32(bytes, AT_PAYLOAD_BYTES);

    if (payload_bytes > length_bytes || table_end > payload_bytes)
        return false;
    if (get32(bytes, AT_ZERO) != 0 || get32(bytes, AT_PARENT_ID) >= pages_of_file)
        return false;
    for (uint32_t i = 0; i < refs; i++) {
        mn_block_ref ref = mni_frame_ref(bytes, i);
        if (ref.id == 0 || ref.pages == 0 || (uint64_t)ref.id + ref.pages > pages_of_file)
            return false;
    }
    return true;
}

mni_frame_fault mni_frame_check(const void *bytes, mn_block_ref ref, uint64_t build_id,
                                uint64_t file_bytes) {
    MN_ASSERT(ref.pages > 0);
    if (get32(bytes, AT_MAGIC) != MNI_FRAME_MAGIC)
        return MNI_FRAME_BAD_MAGIC;
    /* A misplaced block is intact over its own length; one that claims more than was read cannot
     * be told from a damaged one. */
    uint32_t own_pages = get32(bytes, AT_PAGES);
    if (own_pages == 0 || own_pages > ref.pages)
        own_pages = ref.pages;
    uint64_t length_bytes = (uint64_t)own_pages * MN_PAGE_BYTES;
    if (get64(bytes, AT_CHECKSUM) != checksum(bytes, length_bytes))
        return MNI_FRAME_BAD_CHECKSUM;
    if (get64(bytes, AT_BUILD_ID) != build_id)
        return MNI_FRAME_WRONG_BUILD;
    if (get32(bytes, AT_ID) != ref.id || get32(bytes, AT_PAGES) != ref.pages)
        return MNI_FRAME_WRONG_PLACE;
    if (!table_is_sound(bytes, length_bytes, file_bytes))
        return MNI_FRAME_BAD_TABLE;
    return MNI_FRAME_OK;
}

const char *mni_frame_fault_text(mni_frame_fault fault) {
    switch (fault) {
    case MNI_FRAME_OK:
        return "sound";
    case MNI_FRAME_BAD_MAGIC:
        return "it does not begin like a block";
    case MNI_FRAME_BAD_CHECKSUM:
        return "its checksum is wrong";
    case MNI_FRAME_WRONG_BUILD:
        return "it is of another build";
    case MNI_FRAME_WRONG_PLACE:
        return "it belongs to another place in the file";
    case MNI_FRAME_BAD_TABLE:
        return "its references point outside the block or the file";
    }
    MN_ASSERT(!"a fault without words");
    return "";
}

void mni_frame_get(const void *bytes, mni_frame *out) {
    *out = (mni_frame){.kind = get32(bytes, AT_KIND),
                       .refs = get32(bytes, AT_REFS),
                       .payload_bytes = get32(bytes, AT_PAYLOAD_BYTES),
                       .parent_id = get32(bytes, AT_PARENT_ID)};
}

uint32_t mni_frame_pages(const void *bytes) {
    return get32(bytes, AT_PAGES);
}

mn_block_ref mni_frame_ref(const void *bytes, uint32_t index) {
    size_t at = MNI_FRAME_BYTES + (size_t)index * REF_BYTES;
    return (mn_block_ref){.id = get32(bytes, at), .pages = get32(bytes, at + 4)};
}

uint32_t mni_frame_payload_at(uint32_t refs) {
    return MNI_FRAME_BYTES + refs * REF_BYTES; /* a multiple of 8 as it stands */
}

void mni_frame_set_ref(void *bytes, uint32_t index, mn_block_ref ref) {
    size_t at = MNI_FRAME_BYTES + (size_t)index * REF_BYTES;
    put32(bytes, at, ref.id);
    put32(bytes, at + 4, ref.pages);
}

void mni_frame_seal(void *bytes, const mni_frame *frame, mn_block_ref self, uint64_t build_id) {
    MN_ASSERT(self.id > 0 && self.pages > 0);
    MN_ASSERT(frame->payload_bytes <= (uint64_t)self.pages * MN_PAGE_BYTES);
    MN_ASSERT(mni_frame_payload_at(frame->refs) <= frame->payload_bytes);
    put32(bytes, AT_MAGIC, MNI_FRAME_MAGIC);
    put32(bytes, AT_KIND, frame->kind);
    put64(bytes, AT_BUILD_ID, build_id);
    put32(bytes, AT_ID, self.id);
    put32(bytes, AT_PAGES, self.pages);
    put32(bytes, AT_REFS, frame->refs);
    put32(bytes, AT_PAYLOAD_BYTES, frame->payload_bytes);
    put32(bytes, AT_PARENT_ID, frame->parent_id);
    put32(bytes, AT_ZERO, 0);
    put64(bytes, AT_CHECKSUM, checksum(bytes, (uint64_t)self.pages * MN_PAGE_BYTES));
}
