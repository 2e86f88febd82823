/* See work.h. Hidden here: how the folder is locked, what the state file looks like, and how it is
 * known that what lies there is ours, whole, and of this mesh and these options.
 *
 *   OUT.mnt.work/          mode 0700, locked (flock) by the process that builds OUT.mnt
 *       state              phase, identity, facts, sizes and checksums: the struct below
 *       2-0, 2-1, …        phase 2's files
 *
 * The state is written under another name and renamed: before that the phase before counts, and
 * after it this one. Nothing is synced. What the process has written outlives the process, and a
 * disk that lost the last seconds with the machine is found out by the checksums: which is what
 * lets a build of a few hundred milliseconds keep its phases at no cost.
 *
 * The state is checked before a byte of it is believed. The files behind it are as trustworthy as
 * temporary files are: the folder is refused unless it is the user's own and nobody else can write
 * there, and files are those that were written, by their checksums.
 *
 * Memory: the struct, 2 kB. One thread. Paper: none; design.md §3. */
#define _GNU_SOURCE /* O_DIRECTORY, O_NOFOLLOW */
#include "work.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>

#include "mn_assert.h"
#include "file.h"
#include "rounds.h"

static const char state_name[] = "state", new_state_name[] = "state.new";
static const char magic[8] = "mnwork1\n";
static const char *const phase_names[] = {"nothing", "reading", "simplifying", "ordering"};

enum {
    NAME_BYTES = 16,
    OPEN_TRIES = 100,
    LOCK_TRIES = 100, /* 2 s: who was killed has its lock until it has given back its memory */
    LOCK_TRIES_APART_NS = 20000000,
};

typedef struct kept_file {
    uint64_t size_bytes, sum;
} kept_file;

typedef struct state {
    char magic[8];
    uint32_t phase, files, facts_bytes, zero;
    uint64_t options, input; /* what the result depends on */
    kept_file file[MNI_WORK_FILES_MAX];
    unsigned char facts[MNI_WORK_FACTS_MAX];
    uint64_t sum; /* XXH3 of all before */
} state;
_Static_assert(sizeof(state) == 40 + 16 * MNI_WORK_FILES_MAX + MNI_WORK_FACTS_MAX + 8,
               "no padding: it is written as it is");

struct mn_work {
    char *path;
    int folder;                          /* locked */
    bool made;                           /* it was not there before */
    uint64_t options, input;             /* of this build */
    state is;                            /* of what lies there; phase NONE: nothing */
    mni_spill spill[MNI_WORK_FILES_MAX]; /* resumed, until they are taken */
    char note[400];
};

/* ---- what the result depends on -------------------------------------------------------------- */

static uint64_t options_sum(const mn_work_desc *desc) {
    const mn_simplify_desc *s = desc->simplify;
    const uint32_t cells = mni_rounds_cells_for(s->cell_vertices, s->work_bytes);
    const uint64_t option[] = {
        desc->read->weld, desc->read->reader, s->metric,    s->quadrics_alone, cells,
        s->position_bits, MNI_WORK_FACTS_MAX, sizeof(state)};
    return XXH3_64bits_withSeed(option, sizeof option,
                                XXH3_64bits(METANODE_VERSION, sizeof METANODE_VERSION));
}

/* Size, time of the last change, and both ends: a pass over all of it would cost what reading it
 * costs. */
static mn_code input_sum(const char *path, uint64_t *sum, mn_status *st) {
    enum { END_BYTES = 4096 };
    unsigned char bytes[2 * END_BYTES];
    struct stat info;
    mni_in in;
    mn_code code = mni_in_open(&in, path, st);
    if (code != MN_OK)
        return code;
    const uint64_t last = in.size_bytes > END_BYTES ? in.size_bytes - END_BYTES : 0;
    const int64_t first_bytes = mni_in_read(&in, 0, bytes, END_BYTES);
    const int64_t last_bytes = mni_in_read(&in, last, bytes + END_BYTES, END_BYTES);
    int64_t got = first_bytes < last_bytes ? first_bytes : last_bytes;
    if (got >= 0 && fstat(in.fd, &info) != 0)
        got = -errno;
    mni_in_close(&in);
    if (got < 0)
        return mn_fail(st, MN_BAD_INPUT, "%s: cannot read: %s", path, strerror((int)-got));
    const uint64_t facts[] = {in.size_bytes, (uint64_t)info.st_mtim.tv_sec,
                              (uint64_t)info.st_mtim.tv_nsec,
                              XXH3_64bits(bytes, (size_t)first_bytes),
                              XXH3_64bits(bytes + END_BYTES, (size_t)last_bytes)};
    *sum = XXH3_64bits(facts, sizeof facts);
    return MN_OK;
}

/* ---- the folder ------------------------------------------------------------------------------ */

static void file_name(char name[NAME_BYTES], uint32_t phase, uint32_t index) {
    snprintf(name, NAME_BYTES, "%u-%u", phase, index);
}

static bool is_ours(const char *name) {
    if (strcmp(name, state_name) == 0 || strcmp(name, new_state_name) == 0)
        return true;
    return strlen(name) == 3 && name[0] >= '1' && name[0] <= '0' + MN_PHASE_ORDER &&
           name[1] == '-' && name[2] >= '0' && name[2] < '0' + MNI_WORK_FILES_MAX;
}

static bool is_file(int folder, const char *name) {
    struct stat is;
    return fstatat(folder, name, &is, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(is.st_mode);
}

/* Whether it is what a resume would begin with. */
static bool is_of(const char *name, mn_phase phase) {
    return phase != MN_PHASE_NONE && (strcmp(name, state_name) == 0 || name[0] == '0' + (int)phase);
}

typedef enum clearing { LOOK, CLEAR } clearing;

/* False, and said, where something lies there that is not ours. CLEAR: what is ours goes, but for
 * what the phase `spared` has kept. */
static bool look_through(const mn_work *work, clearing what, mn_phase spared, mn_status *st) {
    int copy = openat(work->folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = copy < 0 ? NULL : fdopendir(copy);
    const struct dirent *entry;
    bool good = list != NULL;
    if (!good) {
        if (copy >= 0)
            close(copy);
        mn_fail(st, MN_FAILED, "%s: cannot be listed: %s", work->path, strerror(errno));
        return false;
    }
    while (good && (entry = readdir(list)) != NULL) {
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        good = is_ours(entry->d_name) && is_file(work->folder, entry->d_name);
        if (!good)
            mn_fail(st, MN_FAILED,
                    "%s: holds %.50s, which is not of a build; name another --temp-dir", work->path,
                    entry->d_name);
        else if (what == CLEAR && !is_of(entry->d_name, spared))
            (void)unlinkat(work->folder, entry->d_name, 0);
    }
    closedir(list);
    return good;
}

static bool lock(int folder) {
    const struct timespec apart = {.tv_nsec = LOCK_TRIES_APART_NS};
    for (int i = 0; flock(folder, LOCK_EX | LOCK_NB) != 0; i++) {
        if (errno != EWOULDBLOCK)
            return true; /* a file system without locks */
        if (i == LOCK_TRIES)
            return false;
        nanosleep(&apart, NULL);
    }
    return true;
}

/* Makes or opens the folder and locks it; once more where its last owner removes it meanwhile. */
static mn_code open_folder(mn_work *work, mn_status *st) {
    struct stat here, there;
    for (int i = 0; i < OPEN_TRIES; i++) {
        work->made = mkdir(work->path, 0700) == 0;
        if (!work->made && errno != EEXIST)
            return mn_fail(
                st, mn_code_of_write(errno),
                "%s: cannot be made: %s; name a folder for temporary files with --temp-dir",
                work->path, strerror(errno));
        work->folder = open(work->path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        if (work->folder < 0 && errno == ENOENT)
            continue;
        if (work->folder < 0 || fstat(work->folder, &here) != 0 || here.st_uid != geteuid() ||
            (here.st_mode & 022) != 0)
            return mn_fail(st, MN_FAILED,
                           "%s: not a folder of yours alone; remove it, or name another --temp-dir",
                           work->path);
        if (!lock(work->folder))
            return mn_fail(st, MN_FAILED,
                           "%s: another build has it; wait for its end, or name another output",
                           work->path);
        if (stat(work->path, &there) == 0 && there.st_dev == here.st_dev &&
            there.st_ino == here.st_ino)
            return MN_OK;
        close(work->folder);
        work->folder = -1;
    }
    return mn_fail(st, MN_FAILED, "%s: other builds come and go there; name another output",
                   work->path);
}

static void close_spills(mn_work *work) {
    for (int i = 0; i < MNI_WORK_FILES_MAX; i++)
        mni_spill_close(&work->spill[i]);
}

/* ---- the state ------------------------------------------------------------------------------- */

static uint64_t state_sum(const state *is) {
    return XXH3_64bits(is, offsetof(state, sum));
}

/* Whether it says of itself what can be. */
static bool state_is_sound(const state *is) {
    return memcmp(is->magic, magic, sizeof magic) == 0 && is->sum == state_sum(is) &&
           is->phase > MN_PHASE_NONE && is->phase <= MN_PHASE_ORDER &&
           is->files <= MNI_WORK_FILES_MAX && is->facts_bytes <= MNI_WORK_FACTS_MAX;
}

static bool read_state(const mn_work *work, state *is) {
    unsigned char bytes[sizeof *is + 1];
    mni_in in = {
        .fd = openat(work->folder, state_name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC)};
    if (in.fd < 0)
        return false;
    const bool whole = mni_in_read(&in, 0, bytes, sizeof bytes) == (int64_t)sizeof *is;
    mni_in_close(&in);
    if (whole)
        memcpy(is, bytes, sizeof *is);
    return whole && state_is_sound(is);
}

static mn_code write_state(const mn_work *work, const state *is, mn_status *st) {
    int fd = openat(work->folder, new_state_name,
                    O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0600);
    const ssize_t put = fd < 0 ? -1 : write(fd, is, sizeof *is);
    int error = put == (ssize_t)sizeof *is ? 0 : put < 0 ? errno : ENOSPC;
    if (fd >= 0 && close(fd) != 0 && error == 0)
        error = errno;
    if (error == 0 && renameat(work->folder, new_state_name, work->folder, state_name) != 0)
        error = errno;
    if (error == 0)
        return MN_OK;
    return mn_fail(st, mn_code_of_write(error),
                   "%s: cannot be written to: %s; name another --temp-dir", work->path,
                   strerror(error));
}

/* What can be gone on from; MN_OK also where there is nothing, and the note says so. */
static mn_code resume(mn_work *work, const mn_work_desc *desc, mn_status *st) {
    mn_status ignored = {0};
    state is;
    snprintf(work->note, sizeof work->note, "%s: %s; from the beginning", work->path,
             work->made ? "was not there, so there is nothing to go on from"
                        : "no phase was finished");
    if (!read_state(work, &is))
        return MN_OK;
    if (is.options != work->options)
        return mn_fail(st, MN_USAGE,
                       "%s: was begun with other options, or by another version; give the same, or "
                       "leave out --resume",
                       work->path);
    if (is.input != work->input)
        return mn_fail(st, MN_BAD_INPUT, "%s: has changed since %s was begun; leave out --resume",
                       desc->in, work->path);
    for (uint32_t i = 0; i < is.files; i++) {
        char name[NAME_BYTES];
        file_name(name, is.phase, i);
        if (mni_spill_resume(&work->spill[i], work->path, work->folder, name, is.file[i].size_bytes,
                             is.file[i].sum, &ignored) == MN_OK)
            continue;
        close_spills(work);
        snprintf(work->note, sizeof work->note,
                 "%s: what was kept is not whole any more; from the beginning", work->path);
        return MN_OK;
    }
    work->is = is;
    snprintf(work->note, sizeof work->note, "%s: goes on after %s", work->path,
             phase_names[is.phase]);
    return MN_OK;
}

/* ---- from open to close ---------------------------------------------------------------------- */

/* Not for a refusal: there the folder stays as it is. */
static void release(mn_work *work) {
    if (work == NULL)
        return;
    close_spills(work);
    if (work->folder >= 0)
        close(work->folder);
    free(work->path);
    free(work);
}

mn_code mn_work_open(mn_work **out, const mn_work_desc *desc, mn_status *st) {
    mn_work *work = calloc(1, sizeof *work);
    *out = NULL;
    if (work == NULL || (work->path = strdup(desc->path)) == NULL) {
        free(work);
        return mn_fail(st, MN_FAILED, "out of memory for a build");
    }
    work->folder = -1;
    for (int i = 0; i < MNI_WORK_FILES_MAX; i++)
        work->spill[i].fd = -1;
    work->options = options_sum(desc);
    mn_code code = input_sum(desc->in, &work->input, st);
    if (code == MN_OK)
        code = open_folder(work, st);
    if (code == MN_OK && !look_through(work, LOOK, MN_PHASE_NONE, st))
        code = MN_FAILED;
    if (code == MN_OK && desc->resume)
        code = resume(work, desc, st);
    if (code == MN_OK && !look_through(work, CLEAR, mn_work_done(work), st))
        code = MN_FAILED;
    if (code != MN_OK) {
        release(work);
        return code;
    }
    *out = work;
    return MN_OK;
}

mn_phase mn_work_done(const mn_work *work) {
    return work == NULL ? MN_PHASE_NONE : (mn_phase)work->is.phase;
}

const char *mn_work_note(const mn_work *work) {
    return work->note;
}

mn_code mni_work_take(mn_work *work, void *facts, size_t facts_bytes, mni_spill *const spills[],
                      uint32_t count, mn_status *st) {
    MN_ASSERT(work->is.phase != MN_PHASE_NONE);
    if (work->is.files != count || work->is.facts_bytes != facts_bytes)
        return mn_fail(st, MN_BAD_INPUT, "%s: was kept by another version; leave out --resume",
                       work->path);
    memcpy(facts, work->is.facts, facts_bytes);
    for (uint32_t i = 0; i < count; i++) {
        MN_ASSERT(work->spill[i].fd >= 0); /* once */
        *spills[i] = work->spill[i];
        work->spill[i] = (mni_spill){.fd = -1};
    }
    return MN_OK;
}

mn_code mni_work_keep(mn_work *work, mn_phase phase, const void *facts, size_t facts_bytes,
                      mni_spill *const spills[], uint32_t count, mn_status *st) {
    char name[NAME_BYTES];
    if (work == NULL)
        return MN_OK;
    MN_ASSERT(phase > (mn_phase)work->is.phase && phase <= MN_PHASE_ORDER);
    MN_ASSERT(count <= MNI_WORK_FILES_MAX && facts_bytes <= MNI_WORK_FACTS_MAX);
    state is = {.phase = phase,
                .files = count,
                .facts_bytes = (uint32_t)facts_bytes,
                .options = work->options,
                .input = work->input};
    memcpy(is.magic, magic, sizeof magic);
    memcpy(is.facts, facts, facts_bytes);
    for (uint32_t i = 0; i < count; i++) {
        file_name(name, phase, i);
        mn_code code = mni_spill_name(spills[i], work->folder, name, st);
        if (code != MN_OK)
            return code;
        is.file[i] = (kept_file){spills[i]->size_bytes, mni_spill_sum(spills[i])};
    }
    is.sum = state_sum(&is);
    mn_code code = write_state(work, &is, st);
    if (code != MN_OK)
        return code;
    for (uint32_t i = 0; i < work->is.files; i++) {
        file_name(name, work->is.phase, i);
        (void)unlinkat(work->folder, name, 0);
    }
    work->is = is;
    return MN_OK;
}

void mn_work_close(mn_work *work) {
    mn_status ignored = {0};
    if (work == NULL)
        return;
    if (look_through(work, CLEAR, MN_PHASE_NONE, &ignored))
        (void)rmdir(work->path); /* while it is locked */
    release(work);
}

bool mn_work_leave(mn_work *work) {
    mn_status ignored = {0};
    if (mn_work_done(work) == MN_PHASE_NONE) {
        mn_work_close(work);
        return false;
    }
    (void)look_through(work, CLEAR, mn_work_done(work), &ignored);
    release(work);
    return true;
}
