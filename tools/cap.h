/* Keeping a process to a cap. */
#ifndef METANODE_CAP_H
#define METANODE_CAP_H

#include <stdint.h>

/* Memory that is freed goes back to the kernel; and where a cgroup has hardly more than the cap,
 * nothing is read ahead. Main thread, before there are others. */
void cap_keep(uint64_t ram_bytes);

#endif
