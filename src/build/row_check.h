/* Rows may lie: what makes one safe to look at, and what makes it right. Any thread. */
#ifndef MNI_ROW_CHECK_H
#define MNI_ROW_CHECK_H

#include "block.h"
#include "rows.h"

/* Of a tree: what its rows are held against. */
typedef struct mni_row_limits {
    uint32_t leaves, nodes, simplices;
    float grid_step;
    bool has_colors;
} mni_row_limits;
mni_row_limits mni_row_limits_of(const mn_tree *head, bool has_colors);

/* Is the node at that row where its parent says, with children inside its interval, and are its
 * numbers such that a tally may add them? order_below: its parent's, or past the last. Whoever goes
 * down through such nodes comes by each row once. */
mn_code mni_row_safe(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                     uint32_t simplex_end, const mni_place *place, uint32_t order_below,
                     mn_status *st);
/* Are its switch value and radius as files hold them? */
mn_code mni_row_check_values(const mni_row *row, mn_status *st);
/* Of a node whose values are: position on the grid, both children (NULL: a leaf) nested in it and
 * their values as files hold them. */
mn_code mni_row_check(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                      const float position[3], const mni_row *left, const mni_row *right,
                      mn_status *st);
/* Is it killed there, the corner outside, or none, being the last? */
mn_code mni_row_check_simplex(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                              const mni_row_simplex *simplex, mn_status *st);
/* The row where a root begins: a leaf alone. */
mn_code mni_row_check_first(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                            uint32_t simplex_end, mn_status *st);

/* A root by its leaves. */
typedef struct mni_row_root {
    uint32_t row; /* MN_NONE: a single vertex */
    uint32_t order, leaf_lo, leaf_hi;
} mni_row_root;
/* The root that begins with leaf lo, by rows that are no more than looked at: it is not safe yet.
 * What cannot be read, mni_rows_trouble tells as well. */
mn_code mni_row_root_of(mni_rows *rows, const mni_row_limits *limits, uint32_t lo,
                        mni_row_root *root, mn_status *st);

#endif
