/* A text file that a command writes as it goes on, and that stands under its name only when it is
 * whole: half of one is not mistaken for all of it.
 *
 * Order: open, print to file, close. Main thread. Memory: its names, and stdio's buffer. */
#ifndef OUTPUT_H
#define OUTPUT_H

#include <stdbool.h>
#include <stdio.h>

#include "metanode/status.h"

typedef struct output {
    FILE *file;       /* NULL: not open */
    const char *what; /* "--csv", for lines; the caller's, as name is */
    const char *name;
    char *path; /* where it will be put; NULL: it is written in place */
} output;

/* A file without a name, in the folder of its own, so that it goes with the process however that
 * ends. A device or a pipe is written to as it is; so is a file where the disk knows none without a
 * name. MN_FAILED: it cannot be. */
mn_code output_open(output *o, const char *what, const char *name, mn_status *st);
/* While it is written: has all of it been, as far as is known? */
mn_code output_good(const output *o, mn_status *st);
/* keep: puts it in place. Otherwise, and where that fails, what stood there before stands yet; what
 * was written in place is removed. Harmless on one that is not open. */
mn_code output_close(output *o, bool keep, mn_status *st);

#endif
