/* A file to read blocks from: opens it past the page cache where that is allowed, and picks the
 * method that the machine grants. What is refused is said once, as a warning, and done without.
 *
 * Threads and memory: as method.h. Opening and closing belong to Navigate. */
#ifndef MNI_DISK_H
#define MNI_DISK_H

#include "method.h"

typedef struct mni_disk_desc {
    const char *path;
    mn_io_kind kind;
    uint64_t file_bytes; /* that the file must have at least */
    mni_chunks chunks;   /* page-aligned */
    uint64_t seed;
    mn_sim_desc sim;
    void (*warn)(void *context, const char *text); /* may be NULL */
    void *warn_context;
} mni_disk_desc;

typedef struct mni_disk {
    int fd;
    uint32_t align_bytes; /* that offsets and lengths of reads should be multiples of */
    const mni_method *method;
    void *self; /* the method's */
} mni_disk;

size_t mni_disk_need(void);
/* MN_BAD_INPUT: no such file, or it is shorter than it should be. */
mn_code mni_disk_open(mni_disk *disk, const mni_disk_desc *desc, mni_arena *arena, mn_status *st);
void mni_disk_close(mni_disk *disk);

#endif
