/* What a long build has finished, in a folder of its own: so that after a crash or a kill another
 * process goes on behind the last finished phase instead of from the beginning.
 *
 *   mn_work_open ─┬─ take (of mn_work_done, once) ─┬─ keep (each later phase) … ─ mn_work_close
 *                 └─ from the beginning ───────────┘
 *
 * A phase's files are kept spills (spill.h), which have names from the moment at which all of them
 * are whole; its facts are a struct without pointers. Those of the phase before go then, so the
 * folder holds one phase, or nothing. One thread. */
#ifndef MNI_WORK_H
#define MNI_WORK_H

#include <stddef.h>

#include "metanode/build.h"
#include "spill.h"

enum { MNI_WORK_FILES_MAX = 4, MNI_WORK_FACTS_MAX = 1024 };

/* The phase is finished, and this is all that later ones need of it and those before. The spills
 * are kept ones, whole, at most MNI_WORK_FILES_MAX; they go on as they are. Does nothing where work
 * is NULL. MN_NO_SPACE, MN_FAILED: they could not be given names; what was kept before stands. */
mn_code mni_work_keep(mn_work *work, mn_phase phase, const void *facts, size_t facts_bytes,
                      mni_spill *const spills[], uint32_t count, mn_status *st);
/* What was kept of the phase that mn_work_done tells, in the same numbers; the spills are the
 * caller's. MN_BAD_INPUT: another version of the program kept something else. */
mn_code mni_work_take(mn_work *work, void *facts, size_t facts_bytes, mni_spill *const spills[],
                      uint32_t count, mn_status *st);

#endif
