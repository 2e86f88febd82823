/* What goes from round to round: vertices, simplices and sights, in few bytes each, since they are
 * written and read once a round.
 *
 * Records lie in parcels (tiles.h), one parcel's behind each other: numbers are varints (varint.h),
 * most of them differences to the record before, positions are counted in steps of the grid. Fields
 * that a leaf does not need are not there. A vertex comes to 55 bytes (a leaf) or 135, a triangle
 * to 15.
 *
 * What is lost on the way: of a quadric, what is less than a 2^31st of its largest part; witnesses
 * are rounded to a 32,767th of the farthest one's distance, their slack and switch values up to 8
 * bits (files hold 6 of these); normals to 16 bits. All of it
 * is far below the grid of positions, and the same whoever does it. No memory, any thread. */
#ifndef MNI_WIRE_H
#define MNI_WIRE_H

#include "node_bounds.h"
#include "witness.h"

/* A node has the number of its leaf's vertex, or MNI_COLLAPSE + that of its collapse. */
#define MNI_COLLAPSE 0x80000000u

/* Tiles from low to high, both included. */
typedef struct mni_wire_reach {
    uint32_t low, high;
} mni_wire_reach;

static inline void mni_wire_widen(mni_wire_reach *r, mni_wire_reach by) {
    r->low = by.low < r->low ? by.low : r->low;
    r->high = by.high > r->high ? by.high : r->high;
}

typedef struct mni_wire_vertex {
    uint32_t id, node;
    mni_wire_reach reach; /* its own tile and its neighbours', as far as its last cell saw them */
    float p[3];
    float value, key; /* of its node (mni_part) */
    mni_node_bounds bounds;
    uint32_t leaves, split, levels; /* below its node; below its left child; nodes downwards */
    double quadric[10];             /* c, xx, yy, zz, xy, xz, yz, x, y, z */
    mni_witnesses points;           /* those that are there come first */
} mni_wire_vertex;

typedef struct mni_wire_simplex {
    mni_wire_reach reach; /* of its corners; it lies in the lowest tile */
    uint32_t v[3];        /* ids of vertices; a hinge's third is MN_NONE */
    uint32_t origin[3];   /* the input's */
    float p[3][3];        /* of v; where all corners are in one tile, nobody asks */
    float normal[3];      /* of the input's triangle */
} mni_wire_simplex;

/* Somebody at a vertex's simplex who saw so far. */
typedef struct mni_wire_sight {
    uint32_t id;
    mni_wire_reach reach;
} mni_wire_sight;

/* Where a parcel's records are put, or got, and what the last one was. */
typedef struct mni_wire_pen {
    float step; /* of the grid; 0: there is none */
    uint32_t tile;
    uint32_t id, node, place[3];
} mni_wire_pen;

enum {
    MNI_WIRE_ID_MAX = 5, /* bytes */
    MNI_WIRE_VERTEX_MAX = 224,
    MNI_WIRE_SIMPLEX_MAX = 96,
    MNI_WIRE_SIGHT_MAX = 16,
};

static inline mni_wire_pen mni_wire_pen_open(uint32_t tile, float step) {
    return (mni_wire_pen){.step = step, .tile = tile};
}

/* Put: to has room for the most; behind what was put. Get: of what was put, in the same order, with
 * a pen that begins anew for each kind of record; MNI_VARINT_WINDOW bytes behind it may be read. A
 * vertex's id stands by itself. */
unsigned char *mni_wire_put_id(mni_wire_pen *pen, unsigned char *to, uint32_t id);
uint32_t mni_wire_get_id(mni_wire_pen *pen, const unsigned char **at);
unsigned char *mni_wire_put_vertex(mni_wire_pen *pen, unsigned char *to, const mni_wire_vertex *v);
void mni_wire_get_vertex(mni_wire_pen *pen, const unsigned char **at, uint32_t id,
                         mni_wire_vertex *v);
unsigned char *mni_wire_put_simplex(mni_wire_pen *pen, unsigned char *to,
                                    const mni_wire_simplex *x);
void mni_wire_get_simplex(mni_wire_pen *pen, const unsigned char **at, mni_wire_simplex *x);
unsigned char *mni_wire_put_sight(mni_wire_pen *pen, unsigned char *to, const mni_wire_sight *s);
void mni_wire_get_sight(mni_wire_pen *pen, const unsigned char **at, mni_wire_sight *s);
/* Whether a position can be told in steps of the grid. */
bool mni_wire_on_grid(const float p[3], float step);

#endif
