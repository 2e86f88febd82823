/* What stands in .vdt and .mnt files, decoded. docs/format.md specifies the bytes.
 *
 * Words: metanode/terms.md. Units: lengths in model units; sizes in bytes. */
#ifndef METANODE_FORMAT_H
#define METANODE_FORMAT_H

#include <stdbool.h>
#include <stdint.h>

#include "metanode/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MN_NONE UINT32_MAX /* no leaf, no node: the third corner of a hinge, an absent child */

enum {
    MN_PAGE_BYTES = 4096, /* alignment and unit of blocks in a file: what O_DIRECT asks for */
    MN_ROOTS_MAX = 128,   /* roots that the header page has room for; the build makes one */
};

typedef enum mn_metric { MN_METRIC_QEM = 0, MN_METRIC_LENGTH = 1 } mn_metric;
typedef enum mn_blocking { MN_BLOCKING_PACKED = 0, MN_BLOCKING_LEVELS = 1 } mn_blocking;

/* Normals of the input triangles incident to a node's leaves, all within `angle` of the axis.
 * Quantised conservatively, so that a parent's decoded cone encloses its children's decoded cones.
 * axis: octahedral, two int8 scaled by 127. angle: [0, 254] × a right angle / 255, rounded up; 255
 * says "no bound" (zero-area triangles, or a right angle and more: of no use to anybody). */
enum { MN_CONE_AXIS = 127, MN_CONE_NO_BOUND = 255 };
typedef struct mn_cone {
    int8_t axis[2];
    uint8_t angle;
} mn_cone;
mn_cone mn_cone_make(const float axis[3], float half_angle_rad); /* rounds outwards */
void mn_cone_axis(mn_cone cone, float axis[3]);                  /* a unit vector */
float mn_cone_half_angle(mn_cone cone);                          /* [0, π/2), or π */
/* The smallest cone this representation allows that encloses both (decoded) cones. */
mn_cone mn_cone_merge(mn_cone a, mn_cone b);

/* Half the diagonal of a cell: no point of the surface is further off for being on the grid. */
float mn_grid_error(float grid_step);

/* A block's place: offset = id × 4096, length = pages × 4096. pages 0: no block. */
typedef struct mn_block_ref {
    uint32_t id;
    uint32_t pages;
} mn_block_ref;

/* A root of the forest: the subtree'th subtree of a block, and what other nodes' parents say of
 * them. */
typedef struct mn_root {
    mn_block_ref block;
    uint32_t subtree;
    uint32_t color; /* RGBA8; 0xffffffff in a model without colours */
    float position[3];
} mn_root;

/* What the header of a .mnt says, and, where it makes sense, that of a .vdt. */
typedef struct mn_header {
    uint32_t version;
    uint64_t build_id; /* a hash of content and options, never of time */
    uint64_t
        file_bytes; /* blocks stand in it where their ids say; of compressed ones: would stand */
    uint64_t triangles; /* of the input: hinges are not triangles */
    uint32_t leaves;    /* used vertices */
    uint32_t nodes;     /* leaves + collapses; node order ids are [0, nodes) */
    uint32_t hinges;
    uint32_t legal_last; /* last order id of stage 1; leaves - 1 when stage 1 collapsed nothing */
    bool has_colors;
    double origin[3];                    /* positions in the file are floats relative to it */
    float grid_step;                     /* and multiples of this power of two */
    float box_min[3], box_max[3];        /* of the used vertices, relative to origin */
    float dive_point[3], dive_normal[3]; /* highest vertex along +y, and the normal there */
    mn_metric metric;
    mn_blocking blocking;
    uint32_t l;               /* levels in a meta-node; 0 for packed */
    uint32_t block_bytes;     /* what packed fills; 0 for levels */
    uint32_t block_bytes_max; /* length of the longest block: what a place holder holds */
    uint32_t blocks;
    uint32_t block_depth;         /* blocks on the longest way from a root block down; at least 1 */
    uint32_t overflow_max;        /* longest chain of overflow blocks of one node; 0: none */
    uint32_t depth_max;           /* nodes on the longest way from a root to a leaf */
    uint32_t children_max;        /* most child blocks of one block */
    uint32_t nodes_per_block_max; /* most inner nodes in one block */
    double fill_mean;             /* payload bytes / block_bytes_max, mean over blocks */
    uint32_t roots;
    mn_root root[MN_ROOTS_MAX];
    uint32_t zstd_level; /* each block is compressed by itself; 0: none is, and the rest is 0 */
    uint32_t extent_bytes_max; /* the longest as it is on the disk */
    uint64_t stored_bytes;     /* the file as it is on the disk */
    uint64_t extents_checksum; /* of the table that says where they stand */
} mn_header;

/* Reads and checks the header page of a .mnt. MN_BAD_INPUT names the field that lies.
 * Blocks for one read. */
mn_code mn_header_read(const char *path, mn_header *out, mn_status *st);

#ifdef __cplusplus
}
#endif
#endif
