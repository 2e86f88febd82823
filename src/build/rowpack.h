/* Rows and simplices in few bytes, a page of them at a time: as they lie in temporary files. What
 * is alike in neighbours, in a row and its own number, or in a node and its children is not written
 * twice: 25 bytes a row, 5 a simplex, of 52 and 12.
 *
 *   file   pages of rows │ pages of simplices │ where each begins
 *
 * The last part has a u64 a page, and one more, where the pages end. Any thread. */
#ifndef MNI_ROWPACK_H
#define MNI_ROWPACK_H

#include "rows.h"

enum {
    MNI_ROWS_PAGE = 64,
    MNI_SIMPLICES_PAGE = 256,
    MNI_PAGE_PACKED_MAX = 1 + 64 * (12 * 5 + 3), /* of rows; simplices take less */
};

static inline uint64_t mni_rows_pages(uint64_t rows) {
    return (rows + MNI_ROWS_PAGE - 1) / MNI_ROWS_PAGE;
}
static inline uint64_t mni_simplices_pages(uint64_t simplices) {
    return (simplices + MNI_SIMPLICES_PAGE - 1) / MNI_SIMPLICES_PAGE;
}

/* Of such a file: places in its last part. */
static inline uint64_t mni_rowpack_places(uint64_t rows, uint64_t simplices) {
    return mni_rows_pages(rows) + mni_simplices_pages(simplices) + 1;
}

/* Rows [first, first + count), at most a page, of a tree on that grid; the bytes that they take, at
 * most MNI_PAGE_PACKED_MAX. */
size_t mni_rows_pack(unsigned char *to, const mni_row *row, uint32_t first, uint32_t count,
                     float grid_step);
/* Bytes that were packed: they are ours. */
void mni_rows_unpack(const unsigned char *from, mni_row *row, uint32_t first, uint32_t count,
                     float grid_step);
size_t mni_simplices_pack(unsigned char *to, const mni_row_simplex *simplex, uint32_t count);
void mni_simplices_unpack(const unsigned char *from, mni_row_simplex *simplex, uint32_t count);

#endif
