/* What the machine, and the cgroups that we are in, allow: memory and processors. Main thread only.
 *
 * root: the folder that /proc and /sys are looked for in, "" but for tests. */
#ifndef METANODE_HOST_H
#define METANODE_HOST_H

#include <stdint.h>

/* Physical memory, or the least limit of our memory cgroups where that is lower. */
uint64_t host_ram_bytes(const char *root);
/* What --ram is where it is not given: half of that. The other half is the page cache's, through
 * which temporary files and outputs go. */
uint64_t host_default_ram_bytes(void);
/* Processors on which we may run, or as many as the least quota of our cpu cgroups is worth,
 * rounded up, where those are fewer. At least 1. */
uint32_t host_cpus(const char *root);

#endif
