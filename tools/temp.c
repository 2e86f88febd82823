/* See temp.h. Hidden here: that a temporary file is known by having no name, or one in the folder
 * of finished phases, and that /proc/self/fd lists them: so nobody has to count what is written,
 * what is given back in holes, and what has been closed. The output, while it is written, has no
 * name either, and is counted. */
#include "temp.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

static const double MEGABYTE = 1048576;
static const double LOOKS_APART_S = 0.05;

/* Outputs of one name in two folders may have one --temp-dir: their folders tell them apart. */
static uint32_t hash_of_folder(const char *out) {
    char *copy = strdup(out), *folder = copy == NULL ? NULL : realpath(dirname(copy), NULL);
    uint32_t hash = 2166136261u; /* FNV-1a */
    for (const char *at = folder; at != NULL && *at != 0; at++)
        hash = (hash ^ (unsigned char)*at) * 16777619u;
    free(folder);
    free(copy);
    return hash;
}

/* Where the link leads; false: it is none. */
static bool read_link(const char *link, char to[PATH_MAX]) {
    const ssize_t length = readlink(link, to, PATH_MAX - 1);
    to[length > 0 ? length : 0] = 0;
    return length > 0;
}

static bool holds_phase(const char *work) {
    char path[PATH_MAX];
    const int length = snprintf(path, sizeof path, "%s/state", work);
    return length > 0 && (size_t)length < sizeof path && access(path, F_OK) == 0;
}

static mn_code name_folders(temp_files *files, const char *out, const char *temp_dir,
                            mn_status *st) {
    char *copy = strdup(out), *name = strdup(out);
    int folder_length = -1, work_length = -1, link_length = -1;
    if (copy != NULL && name != NULL) {
        link_length = snprintf(files->link, sizeof files->link, "%s.work", out);
        folder_length = snprintf(files->folder, sizeof files->folder, "%s",
                                 temp_dir != NULL ? temp_dir : dirname(copy));
        work_length = temp_dir != NULL
                          ? snprintf(files->work, sizeof files->work, "%s/%s-%08x.work", temp_dir,
                                     basename(name), hash_of_folder(out))
                          : snprintf(files->work, sizeof files->work, "%s.work", out);
    }
    free(copy);
    free(name);
    if (folder_length < 0 || work_length < 0)
        return mn_fail(st, MN_FAILED, "out of memory for names");
    if ((size_t)folder_length >= sizeof files->folder ||
        (size_t)work_length >= sizeof files->work || (size_t)link_length >= sizeof files->link)
        return mn_fail(st, MN_FAILED, "%.80s…: too long a name", out);
    return MN_OK;
}

mn_code temp_folder(temp_files *files, const char *out, const char *temp_dir, mn_status *st) {
    *files = (temp_files){0};
    return name_folders(files, out, temp_dir, st);
}

mn_code temp_place(temp_files *files, const char *out, const char *temp_dir, bool resume,
                   mn_status *st) {
    if (temp_folder(files, out, temp_dir, st) != MN_OK)
        return st->code;
    const bool linked = read_link(files->link, files->left);
    if (!linked)
        snprintf(files->left, sizeof files->left, "%s", files->link);
    if (resume && temp_dir == NULL && linked) { /* its --temp-dir, remembered */
        char *copy = strdup(files->left);
        if (copy == NULL)
            return mn_fail(st, MN_FAILED, "out of memory for names");
        snprintf(files->folder, sizeof files->folder, "%s", dirname(copy));
        snprintf(files->work, sizeof files->work, "%s", files->left);
        free(copy);
        if (access(files->folder, F_OK) != 0)
            return mn_fail(st, MN_FAILED,
                           "%.200s: what was finished was kept in %.200s, which is not there (%s): "
                           "mount its disk, or leave out --resume to begin anew",
                           out, files->left, strerror(errno));
    } else if (resume && temp_dir != NULL && holds_phase(files->left) &&
               !holds_phase(files->work)) {
        return mn_fail(
            st, MN_USAGE,
            "%.200s: what was finished is kept in %.200s: leave out --temp-dir to go on there", out,
            files->left);
    }
    return MN_OK;
}

void temp_take(temp_files *files) {
    char kept[PATH_MAX];
    if (strcmp(files->link, files->work) != 0)
        return;
    if (read_link(files->link, kept))
        (void)unlink(files->link); /* of a build that is not gone on with */
    files->link[0] = 0;
}

const char *temp_left(const temp_files *files) {
    struct stat left, work;
    if (stat(files->left, &left) != 0 || !S_ISDIR(left.st_mode) ||
        (stat(files->work, &work) == 0 && left.st_dev == work.st_dev && left.st_ino == work.st_ino))
        return NULL;
    return files->left;
}

void temp_begin(const temp_files *files) {
    char kept[PATH_MAX], *work = realpath(files->work, NULL);
    if (files->link[0] != 0 && work != NULL) {
        if (read_link(files->link, kept))
            (void)unlink(files->link);
        (void)!symlink(work,
                       files->link); /* where that cannot be, --temp-dir must be given again */
    }
    free(work);
}

void temp_end(const temp_files *files) {
    char kept[PATH_MAX];
    if (files->link[0] != 0 && read_link(files->link, kept) && access(kept, F_OK) != 0)
        (void)unlink(files->link);
}

/* What a build before this one has left in the folder of finished phases; not where a link leads.
 */
static uint64_t kept_bytes(const char *work) {
    uint64_t bytes = 0;
    struct stat info;
    const int folder = open(work, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *list = folder >= 0 ? fdopendir(folder) : NULL;
    const struct dirent *entry;
    while (list != NULL && (entry = readdir(list)) != NULL)
        if (fstatat(dirfd(list), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) == 0 &&
            S_ISREG(info.st_mode))
            bytes += (uint64_t)info.st_blocks * 512;
    if (list != NULL)
        closedir(list);
    return bytes;
}

/* Of the disk: what is free, and what this build has of it, which is a part of what is planned. */
static mn_code check(const temp_files *files, uint64_t held_bytes, const char *out, mn_status *st) {
    struct statvfs disk;
    if (statvfs(files->folder, &disk) != 0)
        return mn_fail(st, MN_FAILED, "%s: %s; name another folder with --temp-dir", files->folder,
                       strerror(errno));
    const double planned = (double)files->planned_bytes;
    const double left = (double)disk.f_bavail * (double)disk.f_frsize + (double)held_bytes;
    if (disk.f_blocks == 0) /* it does not say: ramfs; or takes no files, which opening one tells */
        return MN_OK;
    if (left < planned)
        return mn_fail(
            st, MN_NO_SPACE,
            "%s: no space in %s: up to %.1f MB are needed for temporary files, %.1f MB are "
            "free; make room, or name another folder with --temp-dir",
            out, files->folder, planned / MEGABYTE, left / MEGABYTE);
    if (isatty(STDERR_FILENO))
        fprintf(stderr, "metanode: up to %.1f MB of temporary files in %s, %.1f MB are free\n",
                planned / MEGABYTE, files->folder, left / MEGABYTE);
    return MN_OK;
}

mn_code temp_check(const temp_files *files, const char *out, mn_status *st) {
    /* what is kept is gone on with, or cleared */
    return check(files, kept_bytes(files->work), out, st);
}

mn_code temp_plan(temp_files *files, uint64_t bytes, const char *out, mn_status *st) {
    if (bytes <= files->planned_bytes)
        return MN_OK;
    files->planned_bytes = bytes;
    files->looked_s = 0;
    temp_look(files);
    return check(files, files->held_bytes, out, st);
}

/* Bytes on disk of an open file without a name; 0: it has one, or has been closed meanwhile. By its
 * entry, not by its number: other threads open and close files, and what a number means is theirs.
 */
static uint64_t held_by(int list, const char *fd) {
    struct stat info;
    if (fstatat(list, fd, &info, 0) != 0 || !S_ISREG(info.st_mode) || info.st_nlink > 0)
        return 0;
    return (uint64_t)info.st_blocks * 512;
}

void temp_look(temp_files *files) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    const double now_s = (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
    if (now_s - files->looked_s < LOOKS_APART_S)
        return;
    files->looked_s = now_s;
    DIR *list = opendir("/proc/self/fd");
    const struct dirent *entry;
    files->held_bytes = kept_bytes(files->work); /* whether they are open or not */
    while (list != NULL && (entry = readdir(list)) != NULL)
        files->held_bytes += held_by(dirfd(list), entry->d_name);
    if (files->held_bytes > files->peak_bytes)
        files->peak_bytes = files->held_bytes;
    if (list != NULL)
        closedir(list);
}
