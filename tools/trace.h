/* --trace: what happens to place holders, as text. The hook is called under the pool's lock, by
 * whichever thread holds it: it only writes into a ring, which the main thread empties between
 * frames. A full ring drops events, counts them, and says so in the file. */
#ifndef METANODE_TRACE_H
#define METANODE_TRACE_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "metanode/status.h"

typedef struct trace trace;

mn_code trace_open(const char *path, trace **out, mn_status *st);
/* An mn_trace_hook; context: the trace. */
void trace_hook(void *context, uint32_t event, uint32_t block_id, uint32_t slot,
                uint32_t generation, uint32_t value);
mn_code trace_flush(trace *t, uint32_t frame, mn_status *st); /* main thread */
mn_code trace_close(trace *t, mn_status *st);                 /* t may be NULL */
uint64_t trace_bytes(void); /* memory that one takes, for the plan */

#endif
