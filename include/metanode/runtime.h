/* Navigating a .mnt under a cap.
 *
 * A session is one open file with its store, its front and its I/O thread. Two sessions fit in one
 * process. Threads: all calls on a session belong to one thread (Navigate, the one that owns GL);
 * the I/O thread is the session's own. Only mn_session_open, opening, settle and drain (and,
 * with barrier or io_serial, mn_session_frame) wait for a disk. Nothing is allocated after
 * mn_session_open returns. */
#ifndef METANODE_RUNTIME_H
#define METANODE_RUNTIME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "metanode/format.h"
#include "metanode/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- cameras and paths ---------------------------------------------------------------------- */

/* Positions relative to the file's origin, model units. */
typedef struct mn_camera {
    float eye[3], target[3], up[3];
    float fov_y_deg;
} mn_camera;

typedef struct mn_path mn_path;
/* name: "orbit", "dive", "flyover", or a path file (docs/paths.md). Copies what it needs of the
 * header. Freed by mn_path_close. */
mn_code mn_path_open(const char *name, const mn_header *header, float fov_y_deg, mn_path **out,
                     mn_status *st);
/* The camera of frame `frame` of `frames`: a pure function, the same on every machine and run. */
void mn_path_camera(const mn_path *path, uint32_t frame, uint32_t frames, mn_camera *out);
uint32_t mn_path_frames(const mn_path *path); /* as recorded in a path file; 0: any number */
uint64_t mn_path_bytes(const mn_path *path);  /* memory that it takes, for a session's base_bytes */
void mn_path_close(mn_path *path);

/* Writing a path file: the heading, then a line a key, frames rising from 0. */
extern const char mn_path_heading[];
enum {
    MN_PATH_LINE_BYTES = 256,
    MN_PATH_KEYS_MAX = 1500000, /* of a file; read, with what growing takes, 100 MB */
};
/* One key with its newline; read again it is the same, to the bit. Returns the line's length. */
int mn_path_line(char line[MN_PATH_LINE_BYTES], uint32_t frame, const mn_camera *camera);

/* ---- sessions ------------------------------------------------------------------------------- */

typedef enum mn_store_kind { MN_STORE_PAGED = 0, MN_STORE_MAPPED, MN_STORE_RESIDENT } mn_store_kind;
typedef enum mn_io_kind { MN_IO_URING = 0, MN_IO_PREAD, MN_IO_SIM } mn_io_kind;
enum { MN_K_FROM_RAM = 0, MN_K_MIN = -1 };

/* What `paged` reads before it is asked for: what the camera, extrapolated, will want, nearest in
 * time first; parent and children of every block in use (the paper's rule); nothing. */
typedef enum mn_prefetch {
    MN_PREFETCH_AHEAD = 0,
    MN_PREFETCH_NEIGHBOURS,
    MN_PREFETCH_OFF
} mn_prefetch;

/* What counts for more or less than its error on the screen: factors, 1 and more; 0: the default,
 * 1: off. The tolerance is multiplied by the first two and divided by the last two, by whichever is
 * larger of these. */
typedef struct mn_weights {
    float outside;    /* the frustum; 16 */
    float away;       /* where all normals face away from the eye; 8 */
    float silhouette; /* on silhouettes, and by its share, the sine of the angle between normal and
                         eye, elsewhere; off */
    float light;      /* where normals have all light and none, and by its share elsewhere; off */
    float light_from[3]; /* towards the light: right, up and back of the camera, any length; 0, 0,
                            0: the pictures' key light */
} mn_weights;
#define MN_LIGHT_KEY -0.441, 0.606, 0.662

/* Faults of the simulated disk, each a chance in 1,000 a read. */
typedef struct mn_sim_desc {
    uint32_t delay_us_max; /* virtual; 0: 200 */
    uint32_t reorder, short_read, eio, eagain, corrupt, misplaced;
    uint32_t fault_frames; /* faults stop after so many frames; 0: never */
} mn_sim_desc;

typedef struct mn_session_desc {
    const char *path;    /* the caller's, until close */
    uint64_t ram_bytes;  /* cap of the whole process; 0: none (K and front from defaults) */
    uint64_t base_bytes; /* what the process already takes that the plan must count besides
                            its own baseline (a GL driver is reported apart); 0: none */
    int64_t k;           /* MN_K_FROM_RAM, MN_K_MIN, or a number of place holders */
    mn_store_kind store;
    mn_io_kind io;
    mn_prefetch prefetch;
    bool io_serial; /* all commands of a frame done, in order, before the next */
    bool barrier;   /* each frame's camera stands until nothing changes and nothing is read */
    bool degrade_off;
    uint64_t seed; /* of the simulated disk */
    mn_sim_desc sim;
    float tolerance_px;     /* 0: 1.0, or, with a target of triangles, 2^-10 */
    uint64_t triangles_max; /* active triangles, a target: the tolerance rises from tolerance_px
                               until so many are enough; never more in a frame, but for those that
                               stood. 0: none. Not with degrade_off */
    mn_weights weights;
    uint32_t width_px, height_px; /* 0: 1280 × 720 */
    uint64_t nav_ops;   /* operations a frame, or a single chain of forced splits; 0: no limit */
    float fps;          /* virtual time a frame with sim; 0: free */
    uint32_t front_max; /* active nodes; 0: from the cap */
    bool wide_front_over_wanted; /* resident: compute front_over_wanted each frame (slow) */
    bool closed; /* the caller knows that the input is closed and consistently oriented: checks
                    assert that each edge of each front is used equally often both ways */
    /* That of the first frame; NULL: nobody knows it. With MN_PREFETCH_AHEAD open then reads, and
     * waits for, what it wants of the tree, as far as there are places, in place of the top of the
     * tree. Read at open only */
    const mn_camera *first_camera;
    const char *trace_path; /* a file for what happens (metanode/trace.h); NULL: none. The plan
                               counts its memory */
    /* One line; NULL: silence. On the caller's thread: at open, and once for each bad block. */
    void (*warn)(void *context, const char *text);
    void *warn_context;
} mn_session_desc;

/* What the cap was turned into: planned = base + pool + front + tables, at most the cap. `mapped`
 * and `resident` have a `paged` session's plan and front, so that they can be compared; what they
 * map or read instead of a pool is not counted. */
typedef struct mn_plan {
    uint64_t ram_cap_bytes; /* 0: none was given */
    uint64_t planned_bytes;
    uint64_t base_bytes;   /* code, stacks, libc, kernel memory */
    uint64_t pool_bytes;   /* K × longest block */
    uint64_t front_bytes;  /* nodes, simplices, agenda */
    uint64_t tables_bytes; /* ancestor and hash tables, board, rings */
    uint32_t k, k_min, front_max, simplices_max;
    uint64_t ram_min_bytes; /* the smallest cap that would work with this K rule */
} mn_plan;

typedef struct mn_frame_stats {
    uint32_t frame;
    uint64_t splits, collapses, adapt;
    uint64_t splits_undone; /* besides: of chains that could not be carried out */
    uint64_t triangles_made, triangles_removed; /* by splits, by collapses */
    uint64_t misses, refused_front, refused_budget, refused_pool, waits_dependency;
    uint64_t active_nodes, triangles;
    double nav_ms;            /* of the Navigate loop: no drawing, no statistics, no waiting */
    double nav_cpu_ms;        /* the same, of the processor: what others do does not count */
    double tolerance_px;      /* used, degrading included */
    double error_px;          /* largest projected switch value, the grid's error added, over active
                                 nodes inside the frustum that do not face away; the grid's is that
                                 at the nearest point drawn, or farther where no such node is near */
    double error_inside_px;   /* the same over those that face away as well */
    double front_over_wanted; /* active nodes over those without forced splits; NaN: not computed */
    uint64_t reads, read_bytes, evictions, second_chances, prefetches;
    uint64_t front_hash; /* XXH3 of the sorted active order ids */
    uint32_t blocks_resident;
    uint32_t blocks_in_use; /* with a barrier the most of the frame's rounds, and so is the next */
    uint32_t blocks_with_ancestors; /* in use, and all their ancestors: what K must hold */
    bool changed;                   /* something was split, collapsed or still waits for a read */
} mn_frame_stats;

/* Totals since open; the keys of replay --json that are not a summary over frames. */
typedef struct mn_session_stats {
    uint64_t frames, misses, adapt, refused_front, refused_budget, refused_pool, waits_dependency;
    uint64_t triangles_made, triangles_removed, splits_undone;
    uint64_t active_nodes; /* summed over the frames */
    uint64_t commands, commands_loaded, commands_resident, commands_given_up, commands_failed;
    uint64_t reads, read_bytes, second_chances, prefetches, prefetches_given_up;
    uint64_t prefetches_loaded, prefetches_used; /* used: before their place was taken again */
    uint64_t urgent_up, urgent_down, urgent_down_refused, evictions;
    uint64_t blocks_checked; /* of those read: others had been, with the same bytes */
    uint64_t checksum_failures, io_errors;
    uint64_t nav_lock_waits, nav_lock_wait_ns_max; /* Navigate's waits for a lock, in frames */
    /* Of reads that were in flight, or whose blocks were looked at; 0: simulated */
    uint64_t io_busy_ns;    /* while there were any */
    uint64_t io_depth_ns;   /* summed over those in flight: over the first, how many on average */
    uint64_t io_full_ns;    /* from reads that came to the next, the disk having as many as it
                             * takes in between, blocks that came being looked at meanwhile … */
    uint64_t io_full_bytes; /* … what came */
    uint64_t io_cpu_ns;     /* of the processor, of the I/O thread; 0: simulated */
    uint64_t io_lock_hold_ns_max; /* longest hold of the pool's by the I/O thread */
} mn_session_stats;

typedef struct mn_session mn_session;

mn_code mn_session_open(const mn_session_desc *desc, mn_session **out, mn_status *st);
void mn_session_plan(const mn_session *session, mn_plan *out);
const mn_header *mn_session_header(const mn_session *session);
/* One frame: evaluate, collapse, split, ask for blocks. Never waits for a disk (barrier and
 * io_serial excepted). stats may be NULL. */
void mn_session_frame(mn_session *session, const mn_camera *camera, mn_frame_stats *stats);
/* Before the first frame: one round with a standing camera, and what it has asked for is read. The
 * round's figures in *stats (may be NULL); it counts as no frame, in no total but the store's.
 * false: nothing has changed and nothing is to come, so that a first frame with that camera finds
 * everything. Waits for the disk. */
bool mn_session_opening(mn_session *session, const mn_camera *camera, mn_frame_stats *stats);
/* Frames with a standing camera until nothing changes and nothing is read, at most frames_max.
 * Returns the frames that it took. Waits for the disk between them. */
uint32_t mn_session_settle(mn_session *session, const mn_camera *camera, uint32_t frames_max);
/* Waits until nothing is asked for and nothing is read: all counters of commands agree then. */
void mn_session_drain(mn_session *session);
/* INFINITY: to the roots; below 0: to full detail. */
void mn_session_set_tolerance(mn_session *session, float tolerance_px);
/* From the next frame on the picture has that size, above 0 each way: a window was resized. */
void mn_session_set_size(mn_session *session, uint32_t width_px, uint32_t height_px);
/* From the next frame on; 0: no target. */
void mn_session_set_triangles_max(mn_session *session, uint64_t triangles_max);
/* From the next frame on. */
void mn_session_set_weights(mn_session *session, const mn_weights *weights);
/* Between frames, `paged`: takes a chunk of place holders out of service and gives its memory back
 * to the system, or into service again. false: not now (what is in use needs them all), or there is
 * none. Allocates nothing. The next frame counts as one of a camera that moves. */
bool mn_session_shrink(mn_session *session);
bool mn_session_grow(mn_session *session);
bool mn_session_at_roots(const mn_session *session);
void mn_session_stats_get(const mn_session *session, mn_session_stats *out);
/* All invariants of design.md §6 that a front and a pool can show, by full recount. Asserts. */
void mn_session_check(mn_session *session);
/* Counts active triangles whose normal has a negative dot product with their input triangle's, and
 * in *legal (may be NULL) those of them whose nodes all have order ids up to legal_last. Reads the
 * input's positions through the blocks: `resident` only; slow. */
uint64_t mn_session_foldovers(mn_session *session, uint64_t *legal);
/* Has the trace had trouble, so that no more of it is written? mn_session_end says which. */
bool mn_session_trace_has_failed(const mn_session *session);
/* Both take NULL. end: could the trace be written whole? MN_NO_SPACE, MN_FAILED. */
void mn_session_close(mn_session *session);
mn_code mn_session_end(mn_session *session, mn_status *st);

/* The mesh of the current frame, as the renderer wants it. Pointers live until the next frame.
 * Slots are stable: of a node while it is active, of a simplex too; those that are not active hold
 * stale data. Who has seen an earlier version looks only at the pages of slots that have been
 * written since (mn_front_written). */
enum { MN_FRONT_PAGE = 64 }; /* slots */
typedef struct mn_front {
    uint32_t node_slots;
    const float *position;     /* 3 × node_slots */
    const uint32_t *color;     /* node_slots, RGBA8, or NULL */
    const float *switch_value; /* node_slots; for level-of-detail colours */
    uint32_t simplex_slots;
    const uint32_t *simplex_node; /* 3 × simplex_slots: node slots; [3s] MN_NONE: slot is empty;
                                     [3s+2] MN_NONE: a hinge, not drawn */
    const uint32_t *simplex_leaf; /* 3 × simplex_slots: leaf ids, the input triangle */
    uint64_t triangles;
    uint64_t version;              /* rises with every split and collapse that stays */
    const uint32_t *node_stamp;    /* a page of node slots; NULL: unknown, any may be written */
    const uint32_t *simplex_stamp; /* a page of simplex slots */
} mn_front;
/* May a page with that stamp have been written since the front had that version? Versions up to
 * 2^31 back can be asked for. */
static inline bool mn_front_written(uint32_t stamp, uint64_t version) {
    return stamp - (uint32_t)version < UINT32_C(1) << 31;
}
void mn_session_front(const mn_session *session, mn_front *out);

#ifdef __cplusplus
}
#endif
#endif
