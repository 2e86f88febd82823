/* Opening a file for reading blocks. See disk.h. */
#define _GNU_SOURCE
#include "disk.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "mn_assert.h"
#include "extents.h"
#include "file.h"

size_t mni_disk_need(void) {
    /* A refused io_uring has taken its share before pread takes over. */
    return mni_method_uring.need_bytes() + mni_method_pread.need_bytes() +
           mni_method_sim.need_bytes();
}

static void warn(const mni_disk_desc *desc, const char *what, int error) {
    char text[300];
    if (desc->warn == NULL)
        return;
    snprintf(text, sizeof text, "%s: %s (%s)", desc->path, what, strerror(error));
    desc->warn(desc->warn_context, text);
}

/* Does the device take sectors, and not whole pages only? */
static bool takes_sectors(int fd, void *room) {
    return pread(fd, room, MNI_SECTOR_BYTES, MNI_SECTOR_BYTES) == MNI_SECTOR_BYTES;
}

/* Some file systems take the flag and refuse the reads: so one page is read to see. */
static int open_direct(const mni_disk_desc *desc) {
    int fd = open(desc->path, O_RDONLY | O_CLOEXEC | O_DIRECT);
    if (fd < 0)
        return -1;
    if (pread(fd, desc->chunks.base, MN_PAGE_BYTES, 0) == MN_PAGE_BYTES)
        return fd;
    int error = errno;
    close(fd);
    errno = error;
    return -1;
}

static mn_code open_method(mni_disk *disk, const mni_disk_desc *desc, bool direct, mni_arena *arena,
                           mn_status *st) {
    mni_method_desc method = {.fd = disk->fd,
                              .direct = direct,
                              .file_bytes = desc->file_bytes,
                              .chunks = desc->chunks,
                              .seed = desc->seed,
                              .sim = desc->sim,
                              .warn = desc->warn,
                              .warn_context = desc->warn_context};
    if (desc->kind == MN_IO_SIM) {
        disk->method = &mni_method_sim;
        return disk->method->open(&method, arena, &disk->self, st);
    }
    if (desc->kind == MN_IO_URING) {
        mn_status refused = {0};
        disk->method = &mni_method_uring;
        if (disk->method->open(&method, arena, &disk->self, &refused) == MN_OK)
            return MN_OK;
        if (desc->warn != NULL) {
            char text[sizeof refused.text + 64];
            snprintf(text, sizeof text, "%s; reading with pread instead", refused.text);
            desc->warn(desc->warn_context, text);
        }
    }
    disk->method = &mni_method_pread;
    return disk->method->open(&method, arena, &disk->self, st);
}

mn_code mni_disk_open(mni_disk *disk, const mni_disk_desc *desc, mni_arena *arena, mn_status *st) {
    mni_in plain;
    bool direct = false;
    MN_ASSERT(desc->chunks.all_bytes >= MN_PAGE_BYTES);
    *disk = (mni_disk){.fd = -1, .align_bytes = MNI_SECTOR_BYTES};
    mn_code code = mni_in_open(&plain, desc->path, st);
    if (code != MN_OK)
        return code;
    if (plain.size_bytes < desc->file_bytes) {
        code = mn_fail(st, MN_BAD_INPUT, "%s: has %llu bytes of %llu; copy or build it again",
                       desc->path, (unsigned long long)plain.size_bytes,
                       (unsigned long long)desc->file_bytes);
        mni_in_close(&plain);
        return code;
    }
    disk->fd = plain.fd;
    if (desc->kind != MN_IO_SIM) {
        int fd = open_direct(desc);
        direct = fd >= 0;
        if (direct) {
            mni_in_close(&plain);
            disk->fd = fd;
            if (!takes_sectors(fd, desc->chunks.base))
                disk->align_bytes = MN_PAGE_BYTES;
        } else {
            warn(desc, "the file system refuses O_DIRECT; reading through the page cache", errno);
            /* What is read ahead nobody would tell it to forget. The methods do, of their reads: it
             * forgets whole pages. */
            (void)posix_fadvise(plain.fd, 0, 0, POSIX_FADV_RANDOM);
            disk->align_bytes = MN_PAGE_BYTES;
        }
    }
    code = open_method(disk, desc, direct, arena, st);
    if (code != MN_OK) {
        close(disk->fd);
        disk->fd = -1;
    }
    return code;
}

void mni_disk_close(mni_disk *disk) {
    if (disk->fd < 0)
        return;
    disk->method->close(disk->self);
    close(disk->fd);
    disk->fd = -1;
}
