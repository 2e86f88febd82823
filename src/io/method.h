/* Ways to read from a file: three tables of the same functions (uring, pread, and the simulated
 * disk of the tests), so that what drives them can be run on any.
 *
 * A read is submitted with a tag below MNI_DISK_TAGS and comes back exactly once, by collect, with
 * the bytes that it got or -errno; a tag is not used again before. Short reads, EINTR and EAGAIN
 * come back as they are: going on is the caller's business.
 *
 * Threads: open and close belong to whoever owns the method; submit, collect and advance to one
 * thread at a time. Memory: from the arena (io_uring's own rings are the kernel's). */
#ifndef MNI_METHOD_H
#define MNI_METHOD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"
#include "metanode/runtime.h"

enum {
    MNI_DISK_DEPTH = 32, /* reads in flight: enough for a solid-state disk with blocks of 16 KiB */
    MNI_DISK_TAGS = 2 * MNI_DISK_DEPTH, /* reads that have come while as many more are in flight */
    MNI_COLLECT_WAIT_US = 1000, /* a wait for a completion ends after this, to look at the board */
};

typedef struct mni_read {
    uint64_t offset;
    void *bytes;
    uint32_t length_bytes;
    uint32_t chunk; /* of the place-holder array, for registered buffers */
    uint32_t tag;
} mni_read;

typedef struct mni_done {
    uint32_t tag;
    int32_t result; /* bytes read, 0 at the end of the file, or -errno */
} mni_done;

/* Memory that reads go to, in chunks that can be registered apart. */
typedef struct mni_chunks {
    unsigned char *base;
    size_t chunk_bytes, all_bytes; /* the last chunk may be shorter */
    uint32_t count;
} mni_chunks;

typedef struct mni_method_desc {
    int fd;
    bool direct; /* fd is O_DIRECT; otherwise what was read is dropped from the page cache */
    uint64_t file_bytes;
    mni_chunks chunks;
    uint64_t seed;
    mn_sim_desc sim;
    void (*warn)(void *context, const char *text);
    void *warn_context;
} mni_method_desc;

typedef struct mni_method {
    uint32_t depth; /* reads that may be in flight, at most MNI_DISK_DEPTH */
    uint32_t tags;  /* with those that have come and are being looked at; depth: no read goes on
                     * behind the caller's back, so there is none to look at meanwhile */
    bool own_time;  /* time is virtual and moves by advance only: use no thread */
    size_t (*need_bytes)(void);
    /* On failure nothing stays open; the caller may try another method with the same arena. */
    mn_code (*open)(const mni_method_desc *desc, mni_arena *arena, void **out, mn_status *st);
    void (*close)(void *self);
    bool (*submit)(void *self, const mni_read *read); /* false: no room now, try after collect */
    /* Starts what was submitted and returns completions, at most max. wait: sleeps a little when
     * there is none. */
    uint32_t (*collect)(void *self, mni_done *out, uint32_t max, bool wait);
    /* Gives a chunk's registration back, or renews it: false when refused (reads go on without). */
    bool (*chunk)(void *self, uint32_t chunk, bool used);
    /* own_time: moves the clock to the next completion, or to until_ns if that is earlier; true:
     * something is due. */
    bool (*advance)(void *self, uint64_t until_ns);
    void (*faults)(void *self, bool on); /* own_time */
} mni_method;

extern const mni_method mni_method_uring, mni_method_pread, mni_method_sim;

#endif
