/* Sending what was written: see pace.h. Secret: how the kernel is asked. Memory: none. Threads: the
 * pace is set before there are any. */
#define _GNU_SOURCE /* sync_file_range */
#include "pace.h"

#include <fcntl.h>

#include "metanode/build.h"

static uint64_t pace_bytes = UINT64_MAX;

void mn_write_pace(uint64_t bytes) {
    pace_bytes = bytes == 0 ? UINT64_MAX : bytes;
}

void mni_pace(int fd, uint64_t *unsent, uint64_t count) {
    *unsent += count;
    if (*unsent < pace_bytes)
        return;
    *unsent = 0;
    (void)sync_file_range(fd, 0, 0, SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE);
}
