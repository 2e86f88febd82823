/* A block in the making, and what the two policies and block_write.c share.
 *
 * A draft holds the nodes of one block and what is known right below them. The nodes that it lacks
 * are exits; a policy groups them into runs, each the subtrees of a child block:
 *
 *     draft:   known nodes   [roots | …]   taken ones are the block's, in the order of `list`
 *                 └ not taken, below a taken one: exits  ──►  family.exit, cut into family.run
 *
 * Nodes are called by their rows. Every node is checked for what makes it safe to look at when it
 * comes to be known (row_check.h), and wholly when it is encoded, which happens to each once.
 * Ownership: a plan, its drafts and families belong to one thread. */
#ifndef MNI_PLAN_H
#define MNI_PLAN_H

#include "block.h"
#include "metanode/build.h"
#include "row_check.h"
#include "rows.h"

/* The root of a subtree that another block is to have. */
typedef struct mni_exit {
    uint32_t row, leaf_lo;
    uint32_t nodes; /* inner nodes of its subtree */
    uint32_t order;
    uint32_t depth; /* nodes above it in the tree */
    uint32_t known; /* its place in the draft that it is an exit of */
    float position[3];
} mni_exit;

/* A node that has been looked at: it is the block's, or below it. */
typedef struct mni_known {
    mni_row row;
    uint32_t at; /* its row */
    uint32_t simplex_end;
    float position[3]; /* of the node */
    uint32_t depth;    /* nodes above it in the tree */
    uint32_t taken;    /* by whom it was last: the block, MNI_BLOCK_TAKES, or a trial */
    bool expanded, measured;
    uint32_t child[2];     /* once expanded: known, or MN_NONE: a leaf */
    mni_tally_part part;   /* once measured: what it takes, its inner children being exits */
    uint32_t index;        /* of the block's: in its numbering, once listed */
    uint32_t ref, subtree; /* an exit of the block: where it is */
} mni_known;
enum { MNI_BLOCK_TAKES = 1 };

typedef struct mni_draft {
    mni_known *known;
    uint32_t knowns, knowns_capacity;
    uint32_t roots; /* the first so many, by leaf_lo */
    uint32_t *list; /* the block's nodes in its numbering */
    uint32_t listed, list_capacity;
} mni_draft;

/* A child block: exits [first, next) of the family. */
typedef struct mni_run {
    uint32_t first, next;
    uint32_t small;         /* packed: subtrees of at most so many nodes go with their parent */
    bool whole;             /* all nodes below, no exits, no overflow */
    uint32_t payload_bytes; /* whole, and of levels */
    mni_tally tally;        /* whole */
} mni_run;

typedef struct mni_family {
    mni_exit *exit;
    uint32_t exits, exits_capacity;
    mni_run *run;
    uint32_t runs, runs_capacity;
} mni_family;

/* What was found while blocks were encoded; in the end the whole tree. */
typedef struct mni_found {
    uint64_t nodes, triangles, hinges;
    uint64_t order_sum; /* of the orders' hashes: says whether one is there twice */
    uint32_t depth_max;
    float box_min[3], box_max[3];
    uint32_t top; /* leaf: the highest along +y, the first of several */
    float top_position[3];
} mni_found;

typedef struct mni_plan {
    mni_rows *rows;
    mni_rows_near near;  /* of these */
    const mn_tree *head; /* counts */
    const mn_block_desc *desc;
    mn_status *st;
    mni_row_limits limits;
    uint32_t simplices_max;        /* of one node in its own block; more overflow */
    uint32_t overflow_bytes;       /* length of an overflow block, at most */
    mni_row_simplex *simplex_room; /* simplices_max */
    mni_found found;
} mni_plan;

mn_code mni_plan_open(mni_plan *plan, const mn_tree *head, mni_rows *rows,
                      const mn_block_desc *desc, mn_status *st);
void mni_plan_close(mni_plan *plan);

/* The tree's roots, known in *draft, as a family without runs. MN_USAGE: one is a single vertex. */
mn_code mni_plan_roots(mni_plan *plan, mni_draft *draft, mni_family *roots);

/* The status of a read that failed, or that there was no memory for `what`. */
mn_code mni_plan_trouble(mni_plan *plan, const char *what);
/* Room for `needed` items of an array. false: no memory. */
bool mni_plan_room(void **array, uint32_t needed, uint32_t *capacity, size_t size);

/* A node's record as it stands in a block, without its children. */
void mni_plan_record(const mni_plan *plan, uint32_t at, const mni_row *row, uint32_t simplex_end,
                     const float position[3], mni_node *out);
mni_facts mni_plan_facts(const mni_row *row);
/* ---- drafts --------------------------------------------------------------------------------- */

void mni_draft_free(mni_draft *draft);
/* The block's nodes and its exits, listed as they are; what else is known stays behind. false: no
 * memory. */
bool mni_draft_copy_block(const mni_draft *from, mni_draft *to);
/* Begins a block with those roots, which stand by leaf_lo; nobody has taken them. */
mn_code mni_draft_begin(mni_plan *plan, mni_draft *draft, const mni_exit *root, uint32_t roots);
/* Makes its inner children known. draft->known may move. */
mn_code mni_draft_expand(mni_plan *plan, mni_draft *draft, uint32_t known);
/* Forgets all but the first so many that have become known: the children of others are not. */
void mni_draft_forget(mni_draft *draft, uint32_t knowns);
/* Expands a node and adds it as if its inner children were exits. */
mn_code mni_draft_tally(mni_plan *plan, mni_draft *draft, uint32_t known, mni_tally *tally);
mn_code mni_draft_tally_root(mni_plan *plan, mni_draft *draft, uint32_t known, mni_tally *tally);
static inline bool mni_draft_overflows(const mni_plan *plan, const mni_known *k) {
    return k->simplex_end - k->row.simplex_start > plan->simplices_max;
}
/* Numbers the block's nodes: they must all be expanded, and MNI_BLOCK_NODES_MAX at most. */
mn_code mni_draft_list(mni_plan *plan, mni_draft *draft);
/* The exits of `takes`, who has taken those roots and nodes below them, by leaf_lo where the roots
 * are; runs none. */
mn_code mni_draft_exits(mni_plan *plan, const mni_draft *draft, const mni_exit *root,
                        uint32_t roots, uint32_t takes, mni_family *family);
/* Writes the payload of the listed draft, checking its nodes wholly. tally: its own. Exits have
 * their ref and subtree; nodes that overflow have the references from first_overflow on. */
mn_code mni_draft_encode(mni_plan *plan, const mni_draft *draft, const mni_tally *tally,
                         uint32_t refs, uint32_t first_overflow, void *bytes,
                         uint32_t length_bytes);

/* ---- whole subtrees ------------------------------------------------------------------------- */

/* Adds what the whole subtree takes. *fits: false where a node of it overflows, it is too deep, or
 * its payload alone would end past `limit`; the tally is then of no more use. run: scratch. */
mn_code mni_whole_tally(mni_plan *plan, const mni_exit *root, uint32_t limit, mni_rows_run *run,
                        mni_tally *tally, bool *fits);
/* Writes the payload of a block of whole subtrees, which stand by leaf_lo, checking every node. */
mn_code mni_whole_encode(mni_plan *plan, const mni_exit *root, uint32_t roots,
                         const mni_tally *tally, mni_rows_run *run, void *bytes,
                         uint32_t length_bytes);

/* ---- overflow ------------------------------------------------------------------------------- */

/* What one overflow block of a node takes: of its simplices from `first` on, the next ones. */
typedef struct mni_piece {
    uint32_t first, count;
    uint32_t payload_bytes;
    bool last;
} mni_piece;
/* room: for mni_piece_most(plan) simplices. */
uint32_t mni_piece_most(const mni_plan *plan);
mn_code mni_piece_cut(mni_plan *plan, const mni_known *node, uint32_t first, mni_row_simplex *room,
                      mni_piece *piece);
mn_code mni_piece_encode(mni_plan *plan, const mni_known *node, const mni_piece *piece,
                         mni_row_simplex *room, void *bytes, uint32_t length_bytes);

/* ---- what was found ------------------------------------------------------------------------- */

void mni_found_none(mni_found *found);
void mni_found_leaf(mni_found *found, uint32_t leaf, const float position[3]);
void mni_found_node(mni_found *found, uint32_t order, uint32_t depth);
void mni_found_add(mni_found *to, const mni_found *from);
/* Is it the tree that head promises? MN_BAD_INPUT. */
mn_code mni_found_check(const mni_found *found, const mn_tree *head, mn_status *st);
/* Box and dive point of the header; reads all simplices for the normal there. watch: NULL: none. */
mn_code mni_found_shape(const mni_found *found, mni_rows *rows, const mn_watch *watch,
                        mn_header *header, mn_status *st);

/* ---- the policies --------------------------------------------------------------------------- */

typedef struct mni_packer mni_packer;
mn_code mni_packer_open(mni_packer **packer, mni_plan *plan);
void mni_packer_close(mni_packer *packer); /* NULL is harmless */
/* Groups the tree's roots, which are known in *draft. */
mn_code mni_packer_roots(mni_packer *packer, mni_draft *draft, mni_family *roots);
/* Fills the block of those roots and groups its exits. *tally: its own; all references fit. */
mn_code mni_packer_block(mni_packer *packer, mni_exit *root, uint32_t roots, uint32_t small,
                         mni_draft *draft, mni_family *family, mni_tally *tally);

/* A run for each exit of the family. scratch: for drafts of their blocks. */
mn_code mni_levels_runs(mni_plan *plan, mni_family *family, mni_draft *scratch);
mn_code mni_levels_block(mni_plan *plan, const mni_exit *root, mni_draft *draft, mni_draft *scratch,
                         mni_family *family, mni_tally *tally);

#endif
