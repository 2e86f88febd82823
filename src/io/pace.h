/* How much of what is written may wait in the page cache.
 *
 * A memory cgroup counts the pages of files that are written in it. Version 1 does not slow who
 * writes: where all pages that it could have back are on their way to the disk, and the file system
 * asks for one more and may not wait, the kernel kills. So where there is little room beside the
 * cap, who writes sends as it goes, and waits for what it sent before. */
#ifndef MNI_PACE_H
#define MNI_PACE_H

#include <stdint.h>

/* count bytes have been written to fd; *unsent: of this file, since it was last sent, 0 at first.
 * Without mn_write_pace nothing happens, else it may block on the disk. What goes wrong is left for
 * the next write to find. Any thread, one at a time a file. */
void mni_pace(int fd, uint64_t *unsent, uint64_t count);

#endif
