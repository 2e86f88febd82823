/* From a .mnt to rows in a temporary file.
 *
 * Hides: two walks (mnt_rows.h), for in the file all rows come before all simplices, in the blocks
 * those of a row come after it. Order: see mnt_spill.h. One thread. Memory: a walk's, and buffers.
 * Paper: §3.2. */
#include "mnt_spill.h"

#include <stdlib.h>
#include <string.h>

#include "rowpack_write.h"

enum {
    BUFFER_BYTES = 64 << 10,
    PLACES_BYTES = 4 << 10,
};

typedef struct spiller {
    const mn_open_desc *desc;
    mni_mnt mnt;
    mni_spill file, places;
    mni_rowpack_writer writer;
    unsigned char buffer[BUFFER_BYTES], places_buffer[PLACES_BYTES];
    mn_status *st;
} spiller;

static mn_code put_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    spiller *s = context;
    (void)at;
    (void)child;
    mni_rowpack_row(&s->writer, row);
    return s->file.trouble.code; /* a full disk: end tells of it */
}

static mn_code put_simplex(void *context, const mni_row_simplex *simplex) {
    spiller *s = context;
    mni_rowpack_simplex(&s->writer, simplex);
    return s->file.trouble.code;
}

static mn_code walk(spiller *s, const mni_walk_sink *sink, const char *phase) {
    const mni_walk_desc desc = {.ram_bytes = s->desc->ram_bytes,
                                .held_bytes = sizeof *s,
                                .watch = s->desc->watch,
                                .phase = phase};
    return mni_mnt_walk(&s->mnt, &desc, sink, s->st);
}

static mn_code spill(spiller *s, mni_ordered *out) {
    const mni_walk_sink rows = {.row = put_row, .context = s};
    const mni_walk_sink simplices = {.simplex = put_simplex, .context = s};
    const mni_rowpack_buffer buffer = {s->buffer, sizeof s->buffer};
    const char *dir = s->desc->temp_dir != NULL ? s->desc->temp_dir : ".";
    mn_code code = mni_spill_open(&s->file, dir, s->st);
    if (code == MN_OK)
        code = mni_spill_open(&s->places, dir, s->st);
    if (code != MN_OK)
        return code;
    mni_rowpack_open(&s->writer, &s->file, buffer, &s->places,
                     (mni_rowpack_buffer){s->places_buffer, sizeof s->places_buffer},
                     s->mnt.header.grid_step);
    code = walk(s, &rows, "checking");
    if (code == MN_OK)
        code = walk(s, &simplices, "loading");
    if (code != MN_OK && s->file.trouble.code == MN_OK)
        return code;
    return mni_rowpack_end(&s->writer, (mni_rowpack_buffer){s->places_buffer, PLACES_BYTES},
                           out->sum, s->st);
}

mn_code mni_mnt_spill(const char *path, const mn_open_desc *desc, mni_ordered *out, mn_tree *head,
                      bool *has_colors, mn_status *st) {
    mn_status own = {0};
    spiller *s = malloc(sizeof *s);
    *out = (mni_ordered){.file = {.fd = -1}};
    if (s == NULL)
        return mn_fail(st, MN_FAILED, "%s: no memory to read it", path);
    *s = (spiller){
        .desc = desc, .file = {.fd = -1}, .places = {.fd = -1}, .st = st != NULL ? st : &own};
    mn_code code = mni_mnt_open(&s->mnt, path, s->st);
    if (code == MN_OK)
        code = spill(s, out);
    if (code == MN_OK) {
        const mn_header *h = &s->mnt.header;
        *head = mni_mnt_head(&s->mnt);
        out->bytes_read = 2 * (h->zstd_level > 0 ? h->stored_bytes : h->file_bytes);
        out->bytes_read += s->places.bytes_read;
        out->bytes_written = s->file.bytes_written + s->places.bytes_written;
        *has_colors = s->mnt.header.has_colors;
        out->file = s->file;
        s->file.fd = -1;
    }
    mni_mnt_close(&s->mnt);
    mni_spill_close(&s->file);
    mni_spill_close(&s->places);
    free(s);
    return code;
}
