/* A trace as JSON for Chrome's tracing and for Perfetto. Main thread only. */
#ifndef METANODE_TRACE_CHROME_H
#define METANODE_TRACE_CHROME_H

#include <stdio.h>

#include "metanode/trace.h"

/* The frames [from, to] of the run; rounds and what I/O does belong to the frame before whose end
 * they happen. Memory: a few words for each block. */
mn_code trace_chrome(mn_trace_file *file, uint32_t from, uint32_t to, FILE *out, mn_status *st);

#endif
