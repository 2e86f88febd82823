/* A helper program: a process of its own that reads what we write and writes what we read, in that
 * order, so that neither waits for the other for ever.
 *
 *   open → write … → (end of input) → read … → close
 *
 * close has the last word: what went wrong in the helper says more than the cut stream that we saw.
 * A mesh travels as the stream that src/build/openmesh/stream.h describes. Any thread, one at a
 * time a helper; all calls block. */
#ifndef MNI_HELPER_H
#define MNI_HELPER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "metanode/build.h"

enum { MNI_HELPER_ARGS_MAX = 16, MNI_HELPER_LINE_BYTES = 400 };

/* What is behind a helper: said where the helper is missing, or dies. */
typedef struct mni_helper_program {
    const char *name;    /* of the file */
    const char *library; /* whose bugs it keeps away */
    const char *package; /* Debian's, without which it is not built */
} mni_helper_program;
extern const mni_helper_program mni_helper_openmesh, mni_helper_netcdf;

typedef struct mni_helper {
    const mni_helper_program *program;
    pid_t pid;
    int to, from; /* a socket and a pipe; -1: closed */
    int errors;   /* the helper's standard error: a file in memory, so that it never fills */
    bool cut;     /* a write or read fell short */
    bool given_up;
    mn_watch watch; /* the opener's, from then on: asked while it is read from; may be none */
    uint64_t bytes; /* read so far: what who watches is told */
} mni_helper;

/* Starts the program in helper_dir (as in mn_read_desc) with args, which end with
 * NULL and do not count the program's name. MN_FAILED where it is missing or cannot start. */
mn_code mni_helper_open(mni_helper *helper, const char *helper_dir,
                        const mni_helper_program *program, const char *const *args, mn_status *st);
/* false: the helper is not taking or giving any more; close says why. */
bool mni_helper_write(mni_helper *helper, const void *bytes, size_t count);
void mni_helper_write_end(mni_helper *helper);
bool mni_helper_read(mni_helper *helper, void *bytes, size_t count);
/* Waits for it. MN_OK when it ended with 0 and nothing was cut; `line` (may be NULL) is then the
 * first line that it wrote on standard error. Else `about` (a file's name) begins the message:
 * MN_BAD_INPUT for exit 3, a crash or a limit reached, MN_FAILED for the rest: "interrupted" where
 * who watches wanted no more, or a signal for all of a terminal's processes has ended it. */
mn_code mni_helper_close(mni_helper *helper, const char *about, char line[MNI_HELPER_LINE_BYTES],
                         mn_status *st);

/* A mesh stream's head. */
typedef struct mni_helper_head {
    char magic[8];
    uint64_t vertices, triangles;
    uint32_t has_colors, zero;
} mni_helper_head;
/* false: cut, or no such head. */
bool mni_helper_read_head(mni_helper *helper, mni_helper_head *head);

#endif
