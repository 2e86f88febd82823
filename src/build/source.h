/* A mesh file as a stream of bytes or of words, in constant memory, and the place where it went
 * wrong.
 *
 * The window [at, end) lies in a buffer of its own; *end is always 0, so that scanning words needs
 * no bounds checks. mni_source_have() moves the window on. Everything that fails is said once, in
 * one line, with the file's name and the line (text) or the byte (binary); after that the stream
 * is at its end and the readers need only return.
 * Threads: one. Blocks on the file. */
#ifndef MNI_SOURCE_H
#define MNI_SOURCE_H

#include <locale.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#include "metanode/build.h"

enum {
    MNI_SOURCE_BUFFER_BYTES = 1 << 18, /* large enough for the disk, small enough for a cache */
    MNI_WORD_BYTES_MAX = 512,          /* longest number or keyword */
};

typedef struct mni_source {
    int fd;
    bool text;               /* failures name lines instead of bytes */
    bool over;               /* the last byte of the file is in the buffer */
    uint64_t size;           /* bytes in the file when it was opened */
    struct timespec written; /* last, as of then */
    uint64_t offset;         /* in the file, of buffer[0] */
    uint64_t line;           /* of at, from 1; kept by the text functions only */
    char *buffer;            /* MNI_SOURCE_BUFFER_BYTES + 1 */
    const char *at, *end;
    locale_t c_locale; /* a decimal point is a point whatever the caller's locale says */
    mn_status *st;     /* never NULL */
    mn_progress progress;
    void *progress_context;
    char name[256]; /* the path, fit for one line: shortened, nothing unprintable */
} mni_source;

/* Opens a regular file. MN_BAD_INPUT says why it is not one, or the system's reason. */
bool mni_source_open(mni_source *source, const char *path, const mn_read_desc *desc, mn_status *st);
void mni_source_close(mni_source *source);
/* Whether nobody has written to the file since it was opened. false (and said): what was read may
 * be of both. */
bool mni_source_unchanged(mni_source *source);
/* Says "NAME: line 7: what" in the status. Always false. */
bool mni_source_fail(mni_source *source, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* The slow half of mni_source_have. */
bool mni_source_fill(mni_source *source, size_t bytes);
/* Are there `bytes` (at most the buffer) from `at` on? Moves what is left of the window to the
 * front of the buffer and reads on if need be: pointers into it die. */
static inline bool mni_source_have(mni_source *source, size_t bytes) {
    return (size_t)(source->end - source->at) >= bytes || mni_source_fill(source, bytes);
}
/* Offset of `at`, and bytes from there to the end of the file. */
static inline uint64_t mni_source_offset(const mni_source *source) {
    return source->offset + (uint64_t)(source->at - source->buffer);
}
static inline uint64_t mni_source_left(const mni_source *source) {
    uint64_t offset = mni_source_offset(source);
    return offset < source->size ? source->size - offset : 0;
}
/* Goes `bytes` on. false: the file ends before that. */
bool mni_source_skip(mni_source *source, uint64_t bytes);
/* Starts again at a byte of the file. */
void mni_source_rewind(mni_source *source, uint64_t offset);

/* ---- words ---------------------------------------------------------------------------------- */

/* Moves to the next word of this line; false at its end ('\n' not taken, or end of file). With
 * continued, a backslash before the line's end joins the next line. */
bool mni_text_next(mni_source *source, bool continued);
/* Moves behind the line's end; with continued, behind the last of the joined lines. false at the
 * end of the file. */
bool mni_text_skip_line(mni_source *source, bool continued);
/* Moves to the next word wherever it stands, over empty lines and, if comment is not 0, over what
 * follows that character in a line. false at the end of the file. */
bool mni_text_next_anywhere(mni_source *source, char comment);

/* Each takes the word at `at`. false (and said): not such a number; `what` names it. */
bool mni_text_double(mni_source *source, double *value, const char *what);
bool mni_text_integer(mni_source *source, int64_t *value, const char *what);
/* Takes digits with a sign and stops at any other character, which is the caller's to look at.
 * false, nothing said: no digits, or too many. */
bool mni_text_digits(mni_source *source, int64_t *value);
/* Does a word end here? (Blank, end of line or file, or a backslash.) */
bool mni_text_at_word_end(const mni_source *source);
/* Takes the word at `at` if it is this one, in capitals or not. */
bool mni_text_take(mni_source *source, const char *word);
/* Copies the word at `at`, cut to size - 1 bytes, unprintable ones shown as '?', and takes it. */
void mni_text_word(mni_source *source, char *word, size_t size);
/* The same without taking it: for messages. Returns word. */
const char *mni_text_peek(mni_source *source, char *word, size_t size);

#endif
