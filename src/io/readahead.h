/* Whether the kernel reads ahead of what is asked for.
 *
 * It may do so by megabytes a file (a device's read_ahead_kb). A memory cgroup counts these pages,
 * and while they come they cannot be had back: where there is little room beside the cap they are
 * all there is, and a file system that needs one more and may not wait has the process killed. Our
 * readers ask for their next buffer themselves. */
#ifndef MNI_READAHEAD_H
#define MNI_READAHEAD_H

/* Of a file that has been opened: nothing, or, after mn_readahead_off, none for it. Any thread. */
void mni_readahead(int fd);

#endif
