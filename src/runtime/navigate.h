/* A frame's work on the front: what to collapse, what to split, how far to give way. */
#ifndef MNI_NAVIGATE_H
#define MNI_NAVIGATE_H

#include "agenda.h"
#include "ahead.h"
#include "front.h"
#include "lacking.h"
#include "level.h"
#include "barred.h"
#include "sieve.h"
#include "waiting.h"

enum {
    MNI_CHAIN_MAX = 1 << 16,  /* splits in one chain of forced splits */
    MNI_STACK_MAX = 1 << 13,  /* nodes waiting in one */
    MNI_MISSED_MAX = 32,      /* nodes of a chain that are known to be missing: enough to ask … */
    MNI_SURVEY_MAX = 64,      /* … and splits after the first, for the sake of further ones … */
    MNI_KEPT_MAX = 1 << 12,   /* … and of either where the splits stay */
    MNI_IDLE_MAX = 12,        /* nodes of an early chain that lack a block, and no split between */
    MNI_KEPT_FRAMES = 4,      /* that they stay for, unwanted */
    MNI_ROUND_OPS = 1000,     /* half a millisecond: ten times what it takes to wake I/O */
    MNI_LISTED_MAX = 256,     /* misses of a frame that have another turn in it */
    MNI_SOON_MAX = 1 << 14,   /* nodes found in a frame to be wanted in a moment; more: the next */
    MNI_PLACES_MIN = 1 << 12, /* nodes of a front: fewer are in the cache whatever the order */
    MNI_CROWD_SHARE = 8,      /* of the front's nodes: forks that a frame has to test, in a crowd */
    MNI_NEEDS_MAX = 16, /* blocks that a chain is known to need, where there is so little room */
    MNI_TURNS = 16,     /* frames in which each refused chain has its turn */
};
#define MNI_NOBODY UINT16_MAX /* has pushed the first of a stack */
/* Of the scarcest room, up to which something is split early, or kept. */
#define MNI_EARLY_FILL 0.98

/* What a frame did and could not do (terms in design.md §1). */
typedef struct mni_work {
    uint64_t splits, collapses, misses;
    uint64_t tested; /* forks that are not wanted: does a neighbour block them? */
    uint64_t undone; /* splits of chains that could not be carried out, besides */
    uint64_t triangles_made, triangles_removed;
    uint64_t refused_front, refused_budget, refused_pool, waits_dependency;
    mni_level_refused refused, crowd; /* for want of room in front or pool: level.h */
    bool refused_collapse; /* what is not wanted stands, for want of a block or of budget */
} mni_work;

/* A node whose chain lacked a block. */
typedef struct mni_missed {
    mni_agenda_item item;
    uint32_t block_id; /* for a trace */
} mni_missed;

typedef struct mni_navigator {
    mni_front front;

    /* const after open */
    uint64_t ops_max; /* a frame; 0: no limit */
    double round_ops; /* a round takes so many at least: MNI_ROUND_OPS */
    bool degrades;
    bool looks_ahead;     /* blocks are prefetched by where the camera is going */
    double size;          /* of the model: its radius */
    float coordinate_max; /* and its largest coordinate, either way */
    mni_agenda agenda;
    mni_sieve_batch batch;
    mni_front_ref *stack; /* MNI_STACK_MAX */
    uint16_t *pusher;     /* likewise: where on the stack those stand for whom they must be split */
    uint32_t *chain;      /* chain_max branches */
    uint32_t chain_max;
    mn_block_ref needs[MNI_NEEDS_MAX]; /* of a chain, so many blocks that have no place */
    uint32_t needs_count;
    mni_refusal *refusal; /* nodes_max: of slots that are MNI_NODE_GIVEN_UP */
    mni_barred barred;    /* of those the ones that are wanted */
    mni_lacking lacking;  /* what this frame's chains have found absent */
    mni_waiting waiting;  /* forks that are not wanted and blocked */
    /* nodes_max: until the clock passes that, the last verdict stands. Of slots: unwanted now, and
     * in a moment, or, of those that are barred, wanted; of forks: wanted, now or then, or unwanted
     * and waiting */
    float *fork_due, *slot_due;

    uint32_t fresh[MNI_SIEVE_BATCH]; /* that have become forks, and are to be judged … */
    int fresh_count;                 /* … so many; between passes none */

    /* the frame */
    /* by the session: at open, and when they change */
    uint32_t width_px, height_px;
    mn_weights weights;
    uint64_t triangles_max; /* 0: as many as there is room for */
    mni_lens lens;
    mni_sieve sieve;   /* the lens, in single precision */
    bool early;        /* there is room for what the camera will want in a moment … */
    bool early_splits; /* … which has its turn now … */
    uint32_t *soon;    /* … of these soon_count slots */
    uint32_t soon_count;
    /* of this frame, those that have another turn in it; then of the one before */
    mni_missed missed[MNI_LISTED_MAX];
    uint32_t missed_count;
    double posted;     /* effort of the frame when what it had missed was posted */
    uint32_t frame;    /* from 1 */
    double usual;      /* effort of a frame: the mean of the last ones */
    double effort_max; /* of this one, with what it does for later ones */
    mni_ahead ahead;
    float clock; /* motion of the camera up to now, and at times from 0 again */
    mn_camera camera;
    double tolerance_px; /* as asked for; the lens has what is used */
    double box_away;     /* from the eye to the model's box, in mni_lens_distance_min */
    bool moved;          /* the camera or the tolerance is not the last frame's */
    bool again;          /* a chain refused for no known block may go through now */
    bool crowded;  /* so many collapses come to be tested that they go by place, not by order id */
    bool by_place; /* splits go by place where their errors are alike */
    uint32_t place_shift; /* leaf ids without so many bits are places in keys of splits */
    bool lenient;         /* nothing moved, but blocks came into use or went */
    uint32_t turn; /* of the frame: whose refused chains are tried, at less than their need */
    /* the frame before found no room for something in the pool: so what comes next is sought, as
     * far as there are places for it … */
    bool seeks;
    bool there_only;  /* … and only what is in memory has its turn now */
    uint64_t version; /* of the front, at the end of the last pass of splits */
    uint64_t epoch;   /* of the store, then */
    mni_work work;

    mni_level level; /* of degrading */
} mni_navigator;

/* The front and what else a frame needs, from the arena; for the plan. */
size_t mni_navigator_need_bytes(const mn_header *header, uint32_t nodes_max,
                                uint32_t simplices_max);
/* The caller has set the constants up to `size`, and the size of the picture. */
mn_code mni_navigator_open(mni_navigator *nav, mni_store *store, const mn_header *header,
                           uint32_t nodes_max, uint32_t simplices_max, mni_arena *arena,
                           mn_status *st);
/* The model's largest, either way. */
float mni_coordinate_max(const mn_header *header);
/* One frame between mni_store_frame_begin and _end; work says what came of it. */
void mni_navigator_frame(mni_navigator *nav, const mn_camera *camera, double tolerance_px);
/* After mni_store_frame_end: the level of degrading for the next frame. reading: blocks are still
 * on their way, so it is not known yet what fits. */
void mni_navigator_give_way(mni_navigator *nav, bool reading);
/* Operations of the frame that stay, so far; and what it has cost: a split that is undone is two.
 */
static inline uint64_t mni_navigator_ops(const mni_navigator *nav) {
    return nav->work.splits + nav->work.collapses;
}
static inline double mni_navigator_effort(const mni_navigator *nav) {
    return (double)(mni_navigator_ops(nav) + 2 * nav->work.undone);
}
/* Of the room that is scarcest, the share that is taken. */
double mni_navigator_fill(const mni_navigator *nav);
/* mni_front_check, who waits, and that verdicts which stand are those of the last frame's camera.
 * Asserts. */
void mni_navigator_check(mni_navigator *nav);
/* Largest projected switch value over the active nodes inside the frustum that do not face away,
 * with the grid's error at the nearest point drawn or beneath them; *inside_px: over all of them
 * that are inside. Looks at every triangle: statistics. */
double mni_navigator_error_px(const mni_navigator *nav, double *inside_px);
/* From there to the box of the model, than which nothing of it is nearer. */
double mni_navigator_to_box(const mni_navigator *nav, const double eye[3]);
/* Nodes of the front over those it would have without forced splits. */
double mni_navigator_front_over_wanted(const mni_navigator *nav);

#endif
