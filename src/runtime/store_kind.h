/* What the three stores have in common: a table of functions behind the ancestor table.
 *
 * store.c knows which blocks are in use and whose children they are; a kind knows where their bytes
 * are. Navigate only, but for what a kind does inside. */
#ifndef MNI_STORE_KIND_H
#define MNI_STORE_KIND_H

#include "store.h"

/* A block wanted: by a split (down, with its overflow blocks) or by a collapse (up). */
typedef enum mni_way { MNI_WAY_DOWN = 0, MNI_WAY_UP, MNI_WAY_OVERFLOW } mni_way;
typedef struct mni_wish {
    mni_way way;
    mn_block_ref ref;
    mn_block_ref parent;     /* who refers to it; id 0: nobody, a root block */
    uint32_t grandparent_id; /* of the parent's own frame; 0: parent is a root block */
    bool adds;               /* granting it adds an entry to the ancestor table */
    uint32_t table_count;    /* |A| */
    uint32_t in_use;         /* blocks with usage above 0 */
} mni_wish;

/* The usage of a block by its id; what the pool's recount compares with. */
typedef uint32_t (*mni_usage_of)(const void *context, uint32_t block_id);

typedef struct mni_store_kind {
    size_t (*need_bytes)(const mn_header *header, uint32_t k);
    uint32_t (*entries_max)(const mn_header *header, uint32_t k);
    /* On failure nothing is left open. */
    mn_code (*open)(const mni_store_desc *desc, mni_arena *arena, void **out, mn_status *st);
    void (*close)(void *self);
    /* Brings a block whose usage is 0 into use. *bytes stay until leave. */
    mni_answer (*enter)(void *self, const mni_wish *wish, const void **bytes);
    /* The usage has become 0; gone: the entry in the ancestor table as well. */
    void (*leave)(void *self, uint32_t block_id, bool gone);
    mni_answer (*overflow)(void *self, const mni_wish *wish, const void **bytes);
    /* NULL: nothing to do. A node has left a block that stays in use: what is asked for next is
     * another attempt. And: what was asked for was one, and what leaves is not given back by it. */
    void (*left)(void *self);
    void (*attempt_over)(void *self);
    /* See mni_store_refusal and mni_store_refuse; and what the rules leave for blocks that are not
     * in use. NULL: there are no rules. */
    mni_refusal (*refusal)(const void *self, bool alone);
    void (*refuse)(void *self, const mni_refusal *known, uint32_t table_count, uint32_t in_use);
    int64_t (*room)(const void *self, uint32_t table_count, uint32_t in_use);
    bool (*has_place)(const void *self, uint32_t block_id); /* of what is not in the table */
    void (*no_room)(void *self, const mni_wish *wish, uint32_t blocks);
    double (*fill)(const void *self, uint32_t table_count, uint32_t in_use);
    /* Of a block that was answered "absent": is it asked for, and has not failed? NULL: never. */
    bool (*comes)(void *self, uint32_t block_id);
    /* NULL: nothing is fetched that is not asked for. */
    void (*look)(void *self, const void *look);
    void (*ahead)(void *self, mn_block_ref ref, uint32_t parent_id, uint32_t frames);
    void (*note)(void *self, uint32_t block_id, const mni_note *note);
    void (*early)(void *self, uint32_t frames);
    /* NULL: there is room for all, and all is there. */
    bool (*there_only)(void *self, bool only);
    bool (*seek)(void *self, uint32_t block_id);
    bool (*has)(void *self, uint32_t block_id);
    void (*frame_begin)(void *self);
    void (*frame_end)(void *self, double frame_s);
    void (*post)(void *self); /* NULL, both: all is there */
    void (*meanwhile)(void *self, double seconds);
    void (*drain)(void *self);
    uint32_t (*pending)(void *self);
    uint64_t (*epoch)(const void *self);
    uint32_t (*resident)(void *self, uint32_t in_use);
    bool (*shrink)(void *self, uint32_t table_count); /* NULL: there are no place holders */
    bool (*grow)(void *self);
    void (*stats)(void *self, mn_session_stats *out);
    void (*check)(void *self, mni_usage_of usage_of, const void *context);
} mni_store_kind;

extern const mni_store_kind mni_store_paged, mni_store_mapped, mni_store_resident;

#endif
