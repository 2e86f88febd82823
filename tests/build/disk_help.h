/* For the tests of what works on disks: what is in temporary files, and disks that fill. */
#ifndef DISK_HELP_H
#define DISK_HELP_H

#include <check.h>
#include <stdlib.h>
#include <sys/resource.h>

#include "exttriangles.h"

/* Files may grow to so many bytes; past that the disk is full (SIGXFSZ is to be ignored). */
static inline void limit_files(rlim_t bytes) {
    struct rlimit limit;
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = bytes;
    ck_assert_int_eq(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

/* All of a spill's bytes; the caller's. */
static inline void *load_spill(mni_spill *spill) {
    unsigned char *all = malloc(spill->size_bytes + 1);
    ck_assert_int_eq(mni_spill_read_at(spill, 0, all, spill->size_bytes), MN_OK);
    return all;
}

/* All triangles of a mesh, each turned as it should be; the caller's. */
static inline mni_exttriangle *load_triangles(mni_extmesh *mesh) {
    enum { BUFFER_BYTES = 100 };
    unsigned char buffer[BUFFER_BYTES];
    mni_exttriangle *all = malloc((mesh->triangles + 1) * sizeof *all);
    const mni_exttriangle *t;
    mni_exttriangles from;
    uint64_t count = 0;
    for (mni_exttriangles_open(&from, mesh, buffer, BUFFER_BYTES);
         (t = mni_exttriangles_next(&from)) != NULL; all[count++] = *t) {
        ck_assert_uint_lt(count, mesh->triangles);
        ck_assert(t->corner[0] <= t->corner[1] && t->corner[0] <= t->corner[2]);
    }
    ck_assert_uint_eq(count, mesh->triangles);
    return all;
}

#endif
