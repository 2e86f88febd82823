/* Rows of bits as planes of bits: so bits that say the same in row after row come to stand side by
 * side, where a compressor of bytes sees them.
 *
 *     8 rows of w bits, one after the other        w bytes: byte j has bit j of each of the 8
 *     ├── row 0 ──┼── row 1 ──┼── …        ◄──►    of group g: at j × groups + g
 *
 * Groups of 8 rows have whole bytes, so as many bytes come out as go in; what is left of the rows,
 * fewer than 8, stays as it is. Pure; any thread; no memory but the callers'. */
#ifndef MNI_PLANES_H
#define MNI_PLANES_H

#include <stdint.h>

enum { MNI_PLANES_BITS_MAX = 1024 }; /* of a row */

/* Where such rows stand in a block. */
typedef struct mni_rows_place {
    uint32_t at;
    uint32_t groups, bits; /* of 8 rows, of a row; 0: there are none */
} mni_rows_place;

/* bytes [0, groups × bits) of each; they must not overlap. */
void mni_planes_of_rows(const uint8_t *rows, uint32_t groups, uint32_t bits, uint8_t *planes);
void mni_planes_to_rows(const uint8_t *planes, uint32_t groups, uint32_t bits, uint8_t *rows);

#endif
