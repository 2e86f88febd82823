/* Writes a file of packed rows and simplices (rowpack.h) from front to back.
 *
 *   open ── row × n ── simplex × m ── end
 *
 * One thread; calls may block on the disk. Failures are told by end. Memory: the caller's. */
#ifndef MNI_ROWPACK_WRITE_H
#define MNI_ROWPACK_WRITE_H

#define XXH_STATIC_LINKING_ONLY /* the state's size */
#include <xxhash.h>

#include "rowpack.h"
#include "spill.h"
#include "tree_rows.h"

typedef struct mni_rowpack_writer {
    mni_spill_writer file, places;
    float grid_step;
    uint64_t file_bytes; /* put so far */
    uint32_t rows, in_page, simplices_in_page;
    mni_row page[MNI_ROWS_PAGE];
    mni_row_simplex simplices[MNI_SIMPLICES_PAGE];
    XXH3_state_t sum[MNI_SECTIONS];
} mni_rowpack_writer;

/* A buffer of a spill's. */
typedef struct mni_rowpack_buffer {
    void *bytes;
    size_t count;
} mni_rowpack_buffer;

/* Both spills are open and empty; places, where pages begin, is needed until end. */
void mni_rowpack_open(mni_rowpack_writer *w, mni_spill *file, mni_rowpack_buffer file_buffer,
                      mni_spill *places, mni_rowpack_buffer places_buffer, float grid_step);
void mni_rowpack_row(mni_rowpack_writer *w, const mni_row *row);
void mni_rowpack_simplex(mni_rowpack_writer *w, const mni_row_simplex *simplex);
/* buffer: for reading places again; a multiple of 8 bytes. sum: XXH3-64 of the sections, as they
 * were before they were packed. MN_NO_SPACE: the disk was full. */
mn_code mni_rowpack_end(mni_rowpack_writer *w, mni_rowpack_buffer buffer,
                        uint64_t sum[MNI_SECTIONS], mn_status *st);

#endif
