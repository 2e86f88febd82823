/* Between the formats and the mesh: readers take words or bytes from a source and push vertices
 * and faces into the intake; the intake welds, rejects, counts and makes the mesh.
 *
 * Every bool here: false means that the status has been filled, and the caller returns at once.
 * Threads: one. */
#ifndef MNI_READER_H
#define MNI_READER_H

#include <stdbool.h>
#include <stdint.h>

#include "metanode/build.h"
#include "source.h"
#include "weld.h"

/* ---- the intake ----------------------------------------------------------------------------- */

/* The design's bound, less one: a node's number is that of a vertex, or of a collapse and 2^31. */
#define MNI_VERTICES_MAX ((UINT64_C(1) << 31) - 1)
/* Half-edges are numbered in 32 bits. */
#define MNI_TRIANGLES_MAX ((uint64_t)(UINT32_MAX - 1) / 3)

typedef struct mni_intake mni_intake;
struct mni_extintake;

/* soup: vertices come with their triangles (STL) and are always welded. name: for messages. */
mni_intake *mni_intake_open(const mn_read_desc *desc, bool soup, const char *name, mn_status *st);
/* What the file claims, checked by the reader against its size: refused here when it exceeds a
 * limit or the cap, before anything is allocated. Optional; 0: not known. */
bool mni_intake_expect(mni_intake *intake, uint64_t vertices, uint64_t triangles);
/* The next vertex. Coordinates may be anything, NaN included. */
bool mni_intake_vertex(mni_intake *intake, const double position[3]);
/* The same, with a colour (RGBA8, R in the low byte). Vertices without get white. */
bool mni_intake_vertex_color(mni_intake *intake, const double position[3], uint32_t rgba);
/* A triangle of vertices counted from 0 in the order of the file, which need not have come yet but
 * must have by mni_intake_finish: that is the reader's to check. */
bool mni_intake_triangle(mni_intake *intake, uint32_t a, uint32_t b, uint32_t c);
/* soup only: a triangle by its corners' positions. */
bool mni_intake_soup_triangle(mni_intake *intake, double corner[3][3]);
uint64_t mni_intake_vertices(const mni_intake *intake); /* pushed so far */
/* Makes the mesh. The intake holds nothing after it and can only be closed. */
bool mni_intake_finish(mni_intake *intake, mn_mesh *out);
void mni_intake_close(mni_intake *intake); /* NULL is allowed */

/* An intake that hands all that is pushed on to x, which stays the caller's to finish and close. */
mni_intake *mni_intake_open_to(struct mni_extintake *x, bool soup, const char *name, mn_status *st);
/* One that wants to hear what the file claims (mni_intake_expect) and nothing more: it fails then.
 */
typedef struct mni_claims {
    bool heard;
    uint64_t vertices, triangles;
} mni_claims;
mni_intake *mni_intake_open_claims(mni_claims *claims, const char *name, mn_status *st);
/* What both intakes say when no triangle is left, false, or none came at all. */
bool mni_intake_any_left(const mn_intake *counts, uint64_t vertices, uint64_t triangles,
                         const char *name, mn_status *st);
/* Where positions are counted from, for a box; exact: floats hold every coordinate as it is. */
void mni_intake_origin(const double low[3], const double high[3], bool exact, double origin[3]);

/* A polygon or strip on its way into triangles: corners come one by one, any number of them. */
typedef struct mni_polygon {
    uint32_t first, previous;
    uint32_t corners; /* saturates at 3 */
} mni_polygon;
bool mni_polygon_corner(mni_polygon *polygon, mni_intake *intake, uint32_t vertex);
/* Ends it. One with fewer than three corners counts as one degenerate triangle. */
bool mni_polygon_end(mni_polygon *polygon, mni_intake *intake);

typedef struct mni_strip {
    uint32_t first, previous;
    uint32_t corners; /* saturates at 2 */
    bool odd;
} mni_strip;
bool mni_strip_corner(mni_strip *strip, mni_intake *intake, uint32_t vertex);
void mni_strip_restart(mni_strip *strip);

/* ---- the formats ---------------------------------------------------------------------------- */

bool mni_read_ply(mni_source *source, mni_intake *intake);
bool mni_read_obj(mni_source *source, mni_intake *intake);
bool mni_read_off(mni_source *source, mni_intake *intake);
bool mni_read_stl_binary(mni_source *source, mni_intake *intake);
bool mni_read_stl_ascii(mni_source *source, mni_intake *intake);
/* The helper program reads the file itself; as: "om", "ply", "obj", "off" or "stl". */
bool mni_read_openmesh(const char *path, const char *as, const mn_read_desc *desc,
                       mni_source *source, mni_intake *intake);
/* About how much memory the helper takes for a file. */
uint64_t mni_openmesh_bytes(const char *path);

/* "face 812: vertex 99 of 88", or what it is a corner of. Always false. */
bool mni_read_out_of_range(mni_source *source, const char *element, uint64_t number, int64_t vertex,
                           uint64_t vertices);
/* A colour channel of 0 … 1 as a byte; what is not a number is 0. */
uint32_t mni_read_channel(double value);
/* RGBA8 of 3 or 4 channels of text, which some write as 0 … 1 and some as 0 … 255: *max begins as
 * 1, and becomes 255 with the first channel above 1. */
uint32_t mni_read_color(const double *channel, int channels, double *max);

#endif
