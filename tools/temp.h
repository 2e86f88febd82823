/* Temporary files of a build: where they lie, how much disk they take, and whether it is there.
 * Main thread, or whoever has the build's progress callback. */
#ifndef METANODE_TEMP_H
#define METANODE_TEMP_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "metanode/status.h"

typedef struct temp_files {
    char folder[PATH_MAX];  /* for files without names: --temp-dir, or the output's */
    char work[PATH_MAX];    /* of the phases that are finished (mn_work): in there */
    char link[PATH_MAX];    /* beside the output, where work is not: leads there; or empty */
    char left[PATH_MAX];    /* where an earlier build of this output had its phases, or work */
    uint64_t planned_bytes; /* at most so many are thought to be needed */
    uint64_t held_bytes, peak_bytes;
    double looked_s; /* when that was */
} temp_files;

/* Chooses both folders, and changes nothing; temp_dir may be NULL: then who resumes goes on where
 * the link leads.
 * MN_USAGE: what is to be resumed lies somewhere else. MN_FAILED: a name that is too long; the
 * folder that is to be gone on with has gone, as with a disk that is not mounted. */
mn_code temp_place(temp_files *files, const char *out, const char *temp_dir, bool resume,
                   mn_status *st);
/* The same for who finishes no phase: what a build has left is neither looked at nor cleared. */
mn_code temp_folder(temp_files *files, const char *out, const char *temp_dir, mn_status *st);
/* The folder is about to be opened: what stands in its place as a link goes. */
void temp_take(temp_files *files);
/* The folder of an earlier build that this one does not go on with, nor has cleared, since it lies
 * elsewhere; NULL: there is none. */
const char *temp_left(const temp_files *files);
/* The work has been opened, or closed: makes the link, or removes it if it leads nowhere. */
void temp_begin(const temp_files *files);
void temp_end(const temp_files *files);
/* MN_NO_SPACE where the folder's disk has less room than what is planned; what an earlier build has
 * kept counts as room. On a terminal that plan is told, on standard error. out: for whose sake. */
mn_code temp_check(const temp_files *files, const char *out, mn_status *st);
/* So many bytes are planned from now on, if that is more than was: checked as above, what the build
 * holds by now counts as room; told on a terminal. */
mn_code temp_plan(temp_files *files, uint64_t bytes, const char *out, mn_status *st);
/* Adds up what this process holds, by its open files. At most 20 times a second; otherwise nothing
 * is done. */
void temp_look(temp_files *files);

#endif
