/* The kernel's read-ahead: see readahead.h. Secret: how it is told. Memory: none. Threads: it is
 * turned off before there are any. */
#include "readahead.h"

#include <fcntl.h>
#include <stdbool.h>

#include "metanode/build.h"

static bool off;

void mn_readahead_off(void) {
    off = true;
}

void mni_readahead(int fd) {
    if (off)
        (void)posix_fadvise(fd, 0, 0, POSIX_FADV_RANDOM);
}
