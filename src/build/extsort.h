/* Sorting more records than memory holds.
 *
 *   open ── put × n ── finish ── next × n ── close
 *
 * Records of one size, ordered by an unsigned number in each; equal ones come out in the order in
 * which they were put, so the result is one thing, whatever the budget. Input that fits the budget
 * (mni_sort_room) touches no disk.
 *
 * Everything that is allocated, this struct included, is one mapping of the budget's size, whose
 * pages are the kernel's until they are used, and again when finish gives them back. One thread a
 * sort; calls may block on the disk. */
#ifndef MNI_EXTSORT_H
#define MNI_EXTSORT_H

#include <stddef.h>
#include <stdint.h>

#include "metanode/status.h"

enum { MNI_SORT_RECORD_MAX = 512 };
#define MNI_SORT_BUDGET_MIN (UINT64_C(32) << 10)

/* Of the host's byte order, at the record's start. */
typedef enum mni_sort_key {
    MNI_SORT_U32 = 0,
    MNI_SORT_U64,
    MNI_SORT_U128, /* the high u64, then the low one */
} mni_sort_key;

/* How records lie on the disk, where that takes fewer bytes: neighbours in order are alike. */
typedef struct mni_sort_packing {
    uint32_t bytes_max; /* of a packed record, at most MNI_SORT_PACKED_MAX */
    /* Behind what was put; before: the record before this one, zeros where it is the first. */
    unsigned char *(*pack)(const void *context, unsigned char *to, const void *record,
                           const void *before);
    /* Behind what was taken; *record is the one before, and becomes this one, to its last bit. */
    const unsigned char *(*unpack)(const void *context, const unsigned char *from, void *record);
    const void *context;
} mni_sort_packing;
enum { MNI_SORT_PACKED_MAX = 512 };

typedef struct mni_sort_desc {
    uint32_t record_bytes; /* a multiple of 4, at least the key's, at most MNI_SORT_RECORD_MAX */
    mni_sort_key key;
    uint64_t budget_bytes; /* at least MNI_SORT_BUDGET_MIN */
    uint64_t after_bytes;  /* what it keeps of them from finish on, at least as much; 0: all */
    const mni_sort_packing *packing; /* outlives the sort; NULL: as they are */
    const char *temp_dir;            /* likewise */
} mni_sort_desc;

typedef struct mni_sort mni_sort;

typedef struct mni_sort_figures {
    uint64_t records;
    uint64_t bytes_read, bytes_written; /* of the temporary file, so far */
    uint64_t runs;                      /* sorted pieces that went to disk; 0: all in memory */
    uint64_t merges;                    /* that wrote; the last one hands out instead */
    uint32_t ways_max;                  /* runs that can be merged at once */
} mni_sort_figures;

/* Records that a sort holds in memory. */
uint64_t mni_sort_room(const mni_sort_desc *desc);

mn_code mni_sort_open(mni_sort **sort, const mni_sort_desc *desc, mn_status *st);
/* Copies the record. After a failure further ones do nothing, and finish tells. */
void mni_sort_put(mni_sort *sort, const void *record);
/* Until there are few enough runs for one merge. MN_NO_SPACE: the temporary files filled the disk.
 */
mn_code mni_sort_finish(mni_sort *sort, mn_status *st);
/* In order; the record stays where it is until the next call, aligned as its size allows (to 8
 * where that is a multiple of 8). NULL: that was all, or *st says why not. */
const void *mni_sort_next(mni_sort *sort, mn_status *st);
mni_sort_figures mni_sort_figures_get(const mni_sort *sort);
/* At any time; NULL is harmless. */
void mni_sort_close(mni_sort *sort);

#endif
