/* From a mesh file to a view-dependence tree to a .mnt.
 *
 * Threads: each call belongs to its caller's thread and shares nothing; two builds may run at once.
 * All of them block on files. Everything that a call hands out is freed by its own _free. */
#ifndef METANODE_BUILD_H
#define METANODE_BUILD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "metanode/format.h"
#include "metanode/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- meshes ------------------------------------------------------------------------------- */

/* What reading kept, rejected and noticed (design.md §3.1). input_faces counts triangles, after
 * fans and strips: input_faces = triangles + duplicate + degenerate + nonfinite. */
typedef struct mn_intake {
    uint64_t input_faces, duplicate_faces, degenerate_faces, nonfinite_faces, misoriented_faces;
    uint64_t unused_vertices, welded_vertices, merged_positions;
} mn_intake;

/* A triangle mesh in memory: all vertices are used, every triangle has three different ones. */
typedef struct mn_mesh {
    uint32_t vertices;
    uint32_t triangles;
    float *position;  /* 3 × vertices, relative to origin */
    uint32_t *color;  /* vertices × RGBA8 (R in the low byte), or NULL */
    uint32_t *corner; /* 3 × triangles */
    double origin[3];
    float grid_step; /* positions are multiples of it; 0: of nothing known */
    mn_intake intake;
    double seconds_read;
    uint64_t bytes_read;
} mn_mesh;

typedef enum mn_weld { MN_WELD_ON = 0, MN_WELD_OFF = 1 } mn_weld;
typedef enum mn_reader { MN_READER_OWN = 0, MN_READER_OPENMESH = 1 } mn_reader;

/* Called now and then from long work: done of total, in `unit`s of the phase. NULL: silence.
 * Returning false asks the work to stop: it then fails with MN_FAILED "interrupted". */
typedef bool (*mn_progress)(void *context, const char *phase, uint64_t done, uint64_t total);
/* The same for calls without a desc; a NULL watch: silence. */
typedef struct mn_watch {
    mn_progress progress;
    void *context;
} mn_watch;

typedef struct mn_read_desc {
    mn_weld weld;       /* default on; STL is always welded */
    mn_reader reader;   /* default: ours; .om always goes through OpenMesh's helper */
    uint64_t ram_bytes; /* memory that reading may take, result included; 0: no bound.
                           Exceeding it is MN_CAP_TOO_SMALL, said before it is allocated */
    /* What the caller will need for such a mesh afterwards, the mesh included, as
     * mn_simplify_need_bytes: held against ram_bytes too, so that a refusal comes early and names
     * a number that works to the end. NULL: nothing. */
    uint64_t (*then_need_bytes)(uint64_t vertices, uint64_t triangles);
    /* Where metanode-openmesh lies; NULL: in METANODE_HELPER_DIR, or beside the running program. */
    const char *helper_dir;
    mn_progress progress;
    void *progress_context;
} mn_read_desc;

/* Reads PLY, STL, OBJ, OFF (and .om), deciding by content. On failure *out is zeroed. */
mn_code mn_mesh_read(const char *path, const mn_read_desc *desc, mn_mesh *out, mn_status *st);
/* About how many vertices and triangles the file has, for plans: what its header says, or (OBJ,
 * ascii STL, .om) a guess from samples. Vertices as they stand in the file, three a triangle in
 * STL; at least two triangles a vertex elsewhere, for faces may have many corners. MN_BAD_INPUT: a
 * header that cannot be. */
mn_code mn_mesh_expect(const char *path, uint64_t *vertices, uint64_t *triangles, mn_status *st);
/* Writes binary little-endian PLY under a temporary name, syncs, renames. */
mn_code mn_mesh_write_ply(const char *path, const mn_mesh *mesh, mn_status *st);
void mn_mesh_free(mn_mesh *mesh);

enum { MN_POSITION_BITS = 16, MN_POSITION_BITS_MIN = 8, MN_POSITION_BITS_MAX = 23 };
/* Moves every vertex to the nearest point of one grid: multiples, about the origin, of the least
 * power of two that cuts the longest side of the bounding box into at most 2^bits steps; bits 0:
 * MN_POSITION_BITS. No coordinate moves by more than half a step. Distinct positions that fall
 * together are added to intake.merged_positions; vertices stay apart, so triangles stay. Before
 * mn_simplify; a tree on no grid cannot be blocked. Takes 8 to 16 bytes a vertex and gives them
 * back. */
mn_code mn_mesh_quantise(mn_mesh *mesh, uint32_t bits, mn_status *st);

/* ---- the view-dependence tree ------------------------------------------------------------- */

typedef struct mn_build_counts { /* for build --json */
    uint64_t nonmanifold_edges, boundary_edges, components;
    uint64_t collapses_by_stage[4];
    /* Collapses made while an edge sharing a vertex with them was legal and cheaper, looked for at
     * one in 64, and at every one of rounds that may have any. Of these the worst: by which factor
     * it cost more, FLT_MAX where the other was next to free; 0: there is none. */
    uint64_t order_violations;
    float order_violation_worst;
    /* No collapse cost more than so many times as much as a legal one beside it; FLT_MAX: no bound;
     * 0: none cost more. But for these: */
    float order_violation_bound;
    /* Collapses of whose order nothing is known: made while simplices were set aside, or beside a
     * hub that took what lay around it cell by cell; a hub's own. */
    uint64_t order_unknown;
    uint64_t rounds; /* 1 in memory */
    double seconds_simplify;
} mn_build_counts;

/* A view-dependence tree (or forest), in memory. Leaf order ids are leaf ids: depth-first, left
 * first. Inner node i (collapse i, in order) has order id leaves + i. A node's position is that of
 * its leaf_lo. Simplices stand sorted by kill node, inside one by input order, hinges last. */
typedef struct mn_tree {
    uint32_t leaves;
    uint32_t inner;     /* collapses; inner = leaves - roots */
    uint32_t simplices; /* triangles + hinges */
    uint32_t triangles;
    uint32_t roots;
    uint32_t legal_last;
    uint32_t depth_max;
    mn_metric metric;
    double origin[3];
    float grid_step;                        /* positions are multiples of it; 0: of nothing known */
    float *leaf_position;                   /* 3 × leaves */
    uint32_t *leaf_color;                   /* leaves, or NULL */
    uint32_t *left, *right;                 /* inner: order ids of the children */
    uint32_t *leaf_lo, *leaf_mid, *leaf_hi; /* inner: left [lo, mid), right [mid, hi) */
    float *switch_value, *radius;           /* inner: error; sphere about the node's position */
    mn_cone *cone;                          /* inner */
    uint32_t *root;                         /* roots: order ids, by leaf_lo */
    uint32_t *simplex_start;                /* inner + 1 */
    uint32_t *corner; /* 3 × simplices: leaf ids in the input's cyclic order; a hinge's third is
                         MN_NONE */
    mn_intake intake;
    mn_build_counts counts;
} mn_tree;

/* What a long build has finished, kept in a folder until it is over; see mn_work_open. */
typedef struct mn_work mn_work;

typedef struct mn_simplify_desc {
    mn_metric metric;        /* default qem */
    bool quadrics_alone;     /* qem: the error on the surface is not measured in advance; for
                                comparisons */
    uint64_t ram_bytes;      /* 0: no bound. Too small: MN_CAP_TOO_SMALL names what would do. The
                                process stays below it if it gives back what it frees: mallopt's
                                M_MMAP_THRESHOLD at 16 KiB, M_ARENA_MAX 1 */
    uint64_t work_bytes;     /* what cells, sorts and buffers share of it, for tests of little
                                memory; 0: all that is left. Where that is too little for cells of
                                cell_vertices these are halved, and the tree is another */
    uint32_t stop_triangles; /* stop when at most so many are left, for benches; then
                                only out->counts is filled; 0: never */
    /* In rounds a mesh is simplified cell by cell: a tree of the same quality, but not the same
     * tree. It depends on the mesh, the metric and cell_vertices alone. mn_vdt_make always goes in
     * rounds, mn_simplify where memory has no room for all at once, or where this is not 0. */
    uint32_t cell_vertices; /* of a cell; 0: 8192 */
    uint32_t position_bits; /* of the grid (mn_mesh_quantise), where it is not made before; 0:
                               MN_POSITION_BITS */
    uint32_t threads;       /* of rounds; 0: 1 */
    const char *temp_dir;   /* of rounds; NULL: the working directory */
    /* mn_vdt_make: the mesh has been read, and with the output up to so many bytes of temporary
     * files are needed, what has been made included. NULL: nobody asks. Other than MN_OK: the call
     * ends with that. */
    mn_code (*disk)(void *progress_context, uint64_t bytes, mn_status *st);
    mn_progress progress;
    void *progress_context;
} mn_simplify_desc;

/* Simplifies the mesh to its roots. The mesh is not changed. On failure *out is zeroed. */
mn_code mn_simplify(const mn_mesh *mesh, const mn_simplify_desc *desc, mn_tree *out, mn_status *st);
/* Bytes that mn_simplify needs at its peak for a mesh of that size, the tree included. */
uint64_t mn_simplify_need_bytes(uint64_t vertices, uint64_t triangles);
/* Structure: intervals nest, order ids rise, switch values and bounds nest, every simplex has a
 * corner in each child of its kill node. MN_BAD_INPUT names the node. Used before writing and
 * after reading. */
mn_code mn_tree_check(const mn_tree *tree, mn_status *st);
void mn_tree_free(mn_tree *tree);

mn_code mn_tree_write(const char *path, const mn_tree *tree, mn_status *st); /* .vdt */
mn_code mn_tree_read(const char *path, mn_tree *out, mn_status *st);
/* Does the file begin like a .vdt? false also where it cannot be read. */
bool mn_tree_is_vdt(const char *path);
/* What the header of a .vdt or .mnt says. MN_BAD_INPUT: it is none. */
mn_code mn_tree_expect(const char *path, uint64_t *vertices, uint64_t *triangles, mn_status *st);

/* ---- going on after a kill ----------------------------------------------------------------- */

typedef enum mn_phase { /* of a build, in their order */
                        MN_PHASE_NONE = 0,
                        MN_PHASE_READ,
                        MN_PHASE_SIMPLIFY,
                        MN_PHASE_ORDER,
} mn_phase;

typedef struct mn_work_desc {
    const char *path; /* the folder, made if need be: on the disk of the temporary files, and for
                         one output alone */
    const char *in;   /* the mesh */
    /* What the result depends on; the rest of both may be another when the work is resumed. */
    const mn_read_desc *read;
    const mn_simplify_desc *simplify;
    bool resume; /* go on behind what was finished; false: what lies there is cleared */
} mn_work_desc;

/* Takes the folder, which only one process can have. With resume, files that were kept are read
 * once and compared with their checksums; if there is nothing whole to go on from, work begins at
 * the beginning, and mn_work_note says why. Refused: MN_USAGE where it was begun with other
 * options, MN_BAD_INPUT where the mesh has changed, MN_FAILED where another build has the folder
 * (it is waited for 2 s: it may have been killed just now), or it holds something else. Nothing is
 * changed then. */
mn_code mn_work_open(mn_work **work, const mn_work_desc *desc, mn_status *st);
/* What need not be done again. */
mn_phase mn_work_done(const mn_work *work);
/* A line for who asked to resume: after which phase it goes on, or why it does not. */
const char *mn_work_note(const mn_work *work);
/* Removes the folder and what is in it. NULL is harmless. */
void mn_work_close(mn_work *work);
/* The same, but what is finished stays as after a kill: where a disk was full, and there may be
 * room the next time. False: nothing is, so all has gone. */
bool mn_work_leave(mn_work *work);

/* Inputs and temporary files that are opened from now on are read without the system's own
 * read-ahead: what is asked for ahead is what we ask for. For memory cgroups with little room
 * beside the cap. The whole process; before it has threads. */
void mn_readahead_off(void);

/* ---- blocks ------------------------------------------------------------------------------- */

typedef struct mn_block_desc {
    mn_blocking blocking; /* default packed */
    uint32_t l;           /* levels only; 0: 5; 1 … 16 */
    uint32_t block_bytes; /* packed only; 0: 8192; a multiple of 4096 in 4096 … 1 MiB */
    uint32_t zstd_level;  /* 0: blocks stand as they are; 1 … 22: each is compressed by itself */
    uint64_t ram_bytes;   /* of a tree on disk: what the process may take; 0: 64 MiB. Decides how
                             often the tree is read, never what is written */
    uint32_t threads;     /* 0: 1; of more than 2, 2 are used. The same bytes for any */
    mn_progress progress;
    void *progress_context;
} mn_block_desc;

typedef struct mn_block_counts {
    double seconds_block, cpu_seconds_block;
    uint64_t bytes_read; /* of the tree, where it is on disk */
    uint64_t bytes_written;
} mn_block_counts;

/* What can be told before there is a tree of so many vertices, at most. MN_CAP_TOO_SMALL: blocks as
 * long as they can be take more than ram_bytes, or compressing packed ones does; it names what
 * would do, least_bytes or more. (What zstd takes for those of levels, only the tree says.) in: for
 * the text. */
mn_code mn_block_fits(const char *in, const mn_block_desc *desc, uint64_t vertices,
                      uint64_t least_bytes, mn_status *st);
/* Cuts the tree into blocks and writes a .mnt: temporary name, sync, rename. */
mn_code mn_block_write(const char *path, const mn_tree *tree, const mn_block_desc *desc,
                       mn_header *header, mn_block_counts *counts, mn_status *st);

/* ---- trees that stay on disk ---------------------------------------------------------------- */

/* A tree of any size: a .vdt, or temporary files of one that is being made, or was in a .mnt. One
 * thread. */
typedef struct mn_vdt mn_vdt;

typedef struct mn_phase_figures {
    double seconds;
    uint64_t bytes_read, bytes_written; /* of all files */
    double cpu_seconds;                 /* of the process, all threads together */
} mn_phase_figures;
typedef struct mn_vdt_figures {
    mn_phase_figures read, simplify, order; /* those that were gone through */
} mn_vdt_figures;

/* Simplifies the mesh at `in`, down to one root, within simplify->ram_bytes for the process (0: as
 * much as keeps it off the disk) and that of read, where it is not 0; the tree depends on the mesh
 * and the options, never on memory or threads. work (may be NULL): where what is finished is kept,
 * and what had been finished is taken up; it outlives the call. simplify->temp_dir (NULL: the
 * working directory) outlives the tree. On failure *out is NULL. MN_BAD_INPUT: as mn_mesh_read.
 * MN_NO_SPACE: temporary files filled the disk. MN_CAP_TOO_SMALL names what would do. */
mn_code mn_vdt_make(const char *in, const mn_read_desc *read, const mn_simplify_desc *simplify,
                    mn_work *work, mn_vdt **out, mn_status *st);
/* The least ram_bytes that it works in, for so many vertices. */
uint64_t mn_vdt_ram_least(const mn_simplify_desc *simplify, uint64_t vertices);
/* What mn_vdt_make and mn_vdt_block may need of the disk of temp_dir for a mesh of that size
 * (mn_mesh_expect) within ram_bytes (0: no bound), the output included. */
uint64_t mn_vdt_temp_bytes(uint64_t vertices, uint64_t triangles, uint64_t ram_bytes);
typedef struct mn_open_desc {
    uint64_t ram_bytes;   /* of the process; 0: no bound */
    const char *temp_dir; /* NULL: the working directory; outlives the tree */
    const mn_watch *watch;
} mn_open_desc;
/* Opens a .vdt, which is read once and compared with its checksums; or a .mnt, whose rows are taken
 * out of its blocks, all of which are checked, into temporary files. desc may be NULL.
 * MN_CAP_TOO_SMALL names what would do; MN_NO_SPACE: temporary files filled the disk. */
mn_code mn_vdt_open(const char *path, const mn_open_desc *desc, mn_vdt **out, mn_status *st);
/* What that may need of the disk of temp_dir for a .mnt of that size. */
uint64_t mn_vdt_open_temp_bytes(uint64_t vertices, uint64_t triangles);
void mn_vdt_close(mn_vdt *vdt); /* NULL is harmless */
/* Counts and facts; the pointers to arrays are NULL. Until close. */
const mn_tree *mn_vdt_head(const mn_vdt *vdt);
bool mn_vdt_has_colors(const mn_vdt *vdt);
const mn_vdt_figures *mn_vdt_figures_of(const mn_vdt *vdt);
/* Writes a .vdt: temporary name, sync, rename. */
mn_code mn_vdt_write(mn_vdt *vdt, const char *path, const mn_watch *watch, mn_status *st);
/* As mn_block_write; within desc->ram_bytes. MN_BAD_INPUT: what stands in the .vdt is no tree. */
mn_code mn_vdt_block(mn_vdt *vdt, const char *path, const mn_block_desc *desc, mn_header *header,
                     mn_block_counts *counts, mn_status *st);

/* ---- looking at a file --------------------------------------------------------------------- */

typedef struct mn_verify_result {
    uint64_t blocks, nodes, simplices, triangles, hinges;
    uint64_t matched_triangles; /* with against: those found in the input, cyclic order kept */
    uint64_t merged_positions;  /* with against: its positions that fall together on the grid */
} mn_verify_result;

typedef struct mn_verify_desc {
    const char *against; /* a mesh; NULL: none */
    mn_read_desc read;   /* how that is read; its progress is told of all. ram_bytes is not asked */
    bool either_weld;    /* the mesh is welded or not, as it then has as many vertices */
    uint64_t ram_bytes;  /* of the process; 0: no bound */
    const char *temp_dir; /* with against; NULL: the working directory */
} mn_verify_desc;

/* Reads the whole .mnt (or .vdt): header, every block once, structure across blocks, and with
 * `against` that full detail is that mesh on the file's grid, triangle for triangle, and each hinge
 * an edge of it. desc may be NULL. The file may be of any size. MN_BAD_INPUT names the first thing
 * that is wrong; MN_CAP_TOO_SMALL, what would do. MN_NO_SPACE: temporary files filled the disk. */
mn_code mn_verify(const char *path, const mn_verify_desc *desc, mn_verify_result *out,
                  mn_status *st);

typedef enum mn_extract { MN_EXTRACT_FULL = 0, MN_EXTRACT_TRIANGLES, MN_EXTRACT_ERROR } mn_extract;
typedef struct mn_extract_desc {
    mn_extract what;
    uint64_t
        triangles; /* MN_EXTRACT_TRIANGLES: the prefix front with the most that are at most this */
    float error;   /* MN_EXTRACT_ERROR: settled front of this tolerance, model units */
    uint64_t ram_bytes;   /* of mn_extract_file: of the process; 0: no bound */
    const char *temp_dir; /* likewise, with error; NULL: the working directory */
} mn_extract_desc;
typedef struct mn_extract_result {
    uint32_t vertices, triangles;
} mn_extract_result;
/* Writes the mesh of a front of a .mnt (or .vdt) as a binary PLY: temporary name, sync, rename. The
 * file may be of any size: it takes 3 bits a vertex, for the front of a tolerance 4, and that
 * writes a temporary file of 4 bytes a vertex where ram_bytes has no room for it.
 * MN_CAP_TOO_SMALL names what would do; MN_NO_SPACE: the disk is full. */
mn_code mn_extract_file(const char *in, const mn_extract_desc *desc, const mn_watch *watch,
                        const char *out, mn_extract_result *result, mn_status *st);
/* The mesh of a front of the tree. owner (may be NULL): receives vertices × order ids of the
 * active nodes, malloc'd, the caller frees. */
mn_code mn_tree_extract(const mn_tree *tree, const mn_extract_desc *desc, mn_mesh *out,
                        uint32_t **owner, mn_status *st);

/* Distances between surfaces: area-uniform samples on one, nearest point on the other. */
typedef struct mn_compare_result {
    double mean_ab, mean_ba; /* from samples on a to b; the other way */
    double rms, max;         /* over both ways */
    uint64_t samples;        /* a side */
} mn_compare_result;
/* Model units; origins are heeded. The same seed, the same figures. */
mn_code mn_mesh_compare(const mn_mesh *a, const mn_mesh *b, uint64_t samples, uint64_t seed,
                        const mn_watch *watch, mn_compare_result *out, mn_status *st);

/* How honest and tight the switch values of a front are (metanode/terms.md: switch value). Samples
 * lie on the input surface, by area. A sample's bound is the largest switch value of the active
 * nodes of its triangle's three leaves, its measured distance that to the front's mesh (a node
 * without triangles counts as its point). It is honest when measured ≤ bound + 1e-7 × diagonal,
 * for positions are floats.
 * A node is measured when it has 100 samples and a measured maximum above 1e-6 × diagonal; its
 * ratio is switch value / that maximum. A sample counts for each active node among its triangle's
 * three (`ratio`), or for that of its nearest corner only (`near`). */
typedef struct mn_error_ratio {
    uint64_t nodes; /* measured */
    double p10, median, p90;
} mn_error_ratio;
typedef struct mn_error_result {
    uint64_t triangles, nodes; /* active */
    uint64_t samples, dishonest;
    double diagonal;              /* of the leaves' bounding box */
    double bound_mean, bound_max; /* over samples */
    double measured_mean, measured_max;
    double excess_max; /* largest measured / bound of a dishonest sample; 0: none, infinite: the
                          bound was 0 */
    mn_error_ratio ratio, near;
} mn_error_result;
/* Of the prefix front with the most triangles that are at most `triangles`. samples 0: 1,000,000,
 * or 120 an active node when that is more, at most 16 million. */
mn_code mn_error_measure(const mn_tree *tree, uint64_t triangles, uint64_t samples, uint64_t seed,
                         const mn_watch *watch, mn_error_result *out, mn_status *st);

/* ---- OpenMesh, in its helper program -------------------------------------------------------- */

/* Both refuse a mesh that is not manifold with MN_BAD_INPUT and the number of triangles that do not
 * fit. helper_dir: as in mn_read_desc. On failure *out is zeroed. */

/* Loop subdivision, 1 … 15 times: each makes four triangles of one. Colours are lost. */
mn_code mn_openmesh_subdivide(const mn_mesh *mesh, uint32_t times, const char *helper_dir,
                              mn_mesh *out, mn_status *st);

typedef struct mn_decimation {
    double seconds; /* of the processor, for the decimation alone */
    uint64_t collapses;
} mn_decimation;

/* Quadric decimation with OpenMesh's ModQuadric and ModNormalFlipping, until at most so many
 * triangles are left or nothing more can be done: the yardstick of our own. */
mn_code mn_openmesh_decimate(const mn_mesh *mesh, uint32_t triangles, const char *helper_dir,
                             mn_mesh *out, mn_decimation *figures, mn_status *st);

/* ---- models of any size -------------------------------------------------------------------- */

typedef enum mn_shape {
    MN_SHAPE_SPHERE = 0,
    MN_SHAPE_TERRAIN,
    MN_SHAPE_ISOSURFACE,
    MN_SHAPE_EARTH
} mn_shape;
typedef struct mn_make_desc {
    mn_shape shape;
    uint64_t triangles;     /* about so many; 0: 100,000. Not of the earth */
    uint64_t seed;          /* same desc: same bytes */
    const char *etopo;      /* earth: a netCDF grid of heights in metres, pole to pole; needed */
    uint32_t stride;        /* earth: takes every so many-th column and row; 0: each */
    double exaggeration;    /* earth: of heights; 0: 20 */
    const char *helper_dir; /* earth: where metanode-netcdf lies; NULL: as in mn_read_desc */
    mn_progress progress;
    void *progress_context;
} mn_make_desc;
/* Streams a binary PLY to path in memory that does not grow with the model (sphere), or grows like
 * an edge of its grid (the others): less than 3 MB for terrain, 10 MB for isosurface at 100 million
 * triangles. MN_BAD_INPUT: no such grid in etopo; MN_USAGE: too few points of it are left. */
mn_code mn_make(const char *path, const mn_make_desc *desc, mn_status *st);

#ifdef __cplusplus
}
#endif
#endif
