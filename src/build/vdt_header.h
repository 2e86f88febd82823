/* The header of a .vdt: what is said of a tree besides its rows and simplices (docs/format.md). */
#ifndef MNI_VDT_HEADER_H
#define MNI_VDT_HEADER_H

#include "file.h"
#include "tree_rows.h"

/* Behind it stand the rows, then the simplices, without a gap. */
typedef struct mni_vdt_header {
    char magic[8];
    uint32_t version, header_bytes;
    uint64_t checksum; /* XXH3-64 of the header with this field 0 */
    uint64_t build_id, file_bytes;
    uint32_t leaves, inner, simplices, triangles;
    uint32_t roots, legal_last, depth_max, metric;
    uint16_t flags;
    uint16_t order_violation_bound; /* the upper half of a float */
    float grid_step;
    double origin[3];
    uint64_t intake[8], counts[8];
    uint32_t rounds;
    float order_violation_worst;
    struct {
        uint64_t offset, bytes, checksum;
    } section[MNI_SECTIONS];
} mni_vdt_header;
_Static_assert(sizeof(mni_vdt_header) == 288, "no padding");

/* Of a tree, of which no array is looked at, whose sections hash to sum. */
void mni_vdt_header_make(mni_vdt_header *h, const mn_tree *facts, bool has_colors,
                         const uint64_t sum[MNI_SECTIONS]);
bool mni_vdt_header_has_colors(const mni_vdt_header *h);
/* Reads and checks all that can be without the rest of the file; facts (arrays NULL) is what it
 * says. MN_BAD_INPUT names the field that lies. */
mn_code mni_vdt_header_read(const mni_in *in, const char *path, mni_vdt_header *h, mn_tree *facts,
                            mn_status *st);
/* Bytes that must be there: MN_BAD_INPUT where the file ends before, naming `what`. */
mn_code mni_vdt_read(const mni_in *in, const char *path, uint64_t offset, void *bytes,
                     uint64_t count, const char *what, mn_status *st);

#endif
