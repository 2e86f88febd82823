/* The header page of a .mnt: 4096 bytes, the file's first. Pure but for mn_header_read; any thread.
 */
#ifndef MNI_HEADER_H
#define MNI_HEADER_H

#include "metanode/format.h"

enum {
    MNI_MNT_VERSION = 3,
    MNI_MNT_OVERFLOW_BYTES = 65536,
    MNI_BLOCK_BYTES = 8192, /* where nobody says otherwise */
    MNI_BLOCK_LEVELS = 5,   /* likewise */
    MNI_BLOCK_BYTES_MAX = 1 << 20,
    MNI_ZSTD_LEVEL_MAX = 22,
};

/* Fills page[0, 4096), checksum included. The header must pass mni_header_check. */
void mni_header_encode(const mn_header *header, void *page);
/* Decodes and checks. name: the file's, for the text. */
mn_code mni_header_decode(const void *page, uint64_t file_bytes, const char *name, mn_header *out,
                          mn_status *st);
/* The fields against each other and the file's true size. */
mn_code mni_header_check(const mn_header *header, uint64_t file_bytes, const char *name,
                         mn_status *st);

#endif
