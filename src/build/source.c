/* A mesh file as bytes and words: buffering, places for messages, and fast numbers.
 *
 * Secret: how the window moves over the file, and how decimal numbers become doubles, exactly
 * rounded as strtod would have them, at some hundred MB/s. Numbers of up to 19 digits and small
 * exponents are made in integer and one floating-point operation; what that cannot decide goes to
 * strtod.
 *
 *   file    ........[##########################]...................
 *   buffer          |taken |at ........... end|0
 *
 * Order: open, anything, close. Threads: one a source. Memory: the buffer. */
#define _GNU_SOURCE 1 /* strtod_l */

#include "source.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <float.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mn_assert.h"
#include "readahead.h"

static void name_for_messages(char *name, size_t size, const char *path) {
    size_t length = strlen(path);
    const char *from = path;
    const char *dots = "";
    if (length >= size) { /* the end of a long path tells more than its beginning */
        dots = "...";
        from = path + length - (size - 1 - strlen(dots));
    }
    snprintf(name, size, "%s%s", dots, from);
    for (char *c = name; *c != 0; c++)
        if ((unsigned char)*c < ' ' || *c == 0x7f)
            *c = '?';
}

static bool open_regular(mni_source *source, const char *path) {
    struct stat about;
    source->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (source->fd < 0 || fstat(source->fd, &about) != 0) {
        mn_fail(source->st, MN_BAD_INPUT, "%s: cannot be opened: %s", source->name,
                strerror(errno));
        return false;
    }
    if (S_ISDIR(about.st_mode)) {
        mn_fail(source->st, MN_BAD_INPUT, "%s: is a directory; name a mesh file", source->name);
        return false;
    }
    if (!S_ISREG(about.st_mode)) {
        mn_fail(source->st, MN_BAD_INPUT,
                "%s: is a pipe or a device; write the mesh to a file first", source->name);
        return false;
    }
    source->size = (uint64_t)about.st_size;
    source->written = about.st_mtim;
    if (source->size == 0) {
        mn_fail(source->st, MN_BAD_INPUT, "%s: is empty", source->name);
        return false;
    }
    return true;
}

bool mni_source_open(mni_source *source, const char *path, const mn_read_desc *desc,
                     mn_status *st) {
    MN_ASSERT(path != NULL && desc != NULL && st != NULL);
    *source = (mni_source){.fd = -1,
                           .line = 1,
                           .st = st,
                           .progress = desc->progress,
                           .progress_context = desc->progress_context};
    name_for_messages(source->name, sizeof source->name, path);
    if (!open_regular(source, path))
        return false;
    posix_fadvise(source->fd, 0, 0, POSIX_FADV_SEQUENTIAL);
    mni_readahead(source->fd);
    source->buffer = malloc(MNI_SOURCE_BUFFER_BYTES + 1);
    source->c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (source->buffer == NULL || source->c_locale == (locale_t)0) {
        mn_fail(st, MN_FAILED, "%s: no memory to read it", source->name);
        return false;
    }
    source->at = source->end = source->buffer;
    source->buffer[0] = 0;
    return true;
}

void mni_source_close(mni_source *source) {
    if (source->c_locale != (locale_t)0)
        freelocale(source->c_locale);
    free(source->buffer);
    if (source->fd >= 0)
        close(source->fd);
    *source = (mni_source){.fd = -1};
}

bool mni_source_unchanged(mni_source *source) {
    struct stat about;
    if (fstat(source->fd, &about) == 0 && (uint64_t)about.st_size == source->size &&
        about.st_mtim.tv_sec == source->written.tv_sec &&
        about.st_mtim.tv_nsec == source->written.tv_nsec)
        return true;
    mn_fail(source->st, MN_BAD_INPUT,
            "%s: has changed while it was read; begin again when nobody writes to it",
            source->name);
    return false;
}

bool mni_source_fail(mni_source *source, const char *format, ...) {
    char what[300];
    va_list args;
    va_start(args, format);
    vsnprintf(what, sizeof what, format, args);
    va_end(args);
    mn_fail(source->st, MN_BAD_INPUT, "%s: %s %llu: %s", source->name,
            source->text ? "line" : "byte",
            (unsigned long long)(source->text ? source->line : mni_source_offset(source)), what);
    return false;
}

/* ---- the window ----------------------------------------------------------------------------- */

bool mni_source_fill(mni_source *source, size_t bytes) {
    MN_ASSERT(bytes <= MNI_SOURCE_BUFFER_BYTES);
    if (source->over)
        return false;
    size_t left = (size_t)(source->end - source->at);
    source->offset = mni_source_offset(source);
    memmove(source->buffer, source->at, left);
    source->at = source->buffer;
    while (left < MNI_SOURCE_BUFFER_BYTES) {
        ssize_t got = read(source->fd, source->buffer + left, MNI_SOURCE_BUFFER_BYTES - left);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            mn_fail(source->st, MN_FAILED, "%s: cannot be read at byte %llu: %s", source->name,
                    (unsigned long long)(source->offset + left), strerror(errno));
        if (got <= 0) {
            source->over = true;
            break;
        }
        left += (size_t)got;
    }
    if (source->progress != NULL &&
        !source->progress(source->progress_context, "read", source->offset + left, source->size)) {
        mn_fail(source->st, MN_FAILED, "%s: interrupted", source->name);
        source->over = true;
        left = 0;
    }
    source->end = source->buffer + left;
    source->buffer[left] = 0;
    return left >= bytes;
}

bool mni_source_skip(mni_source *source, uint64_t bytes) {
    uint64_t here = (uint64_t)(source->end - source->at);
    if (bytes <= here) {
        source->at += bytes;
        return true;
    }
    if (bytes > mni_source_left(source))
        return false;
    mni_source_rewind(source, mni_source_offset(source) + bytes);
    return true;
}

void mni_source_rewind(mni_source *source, uint64_t offset) {
    if (lseek(source->fd, (off_t)offset, SEEK_SET) < 0)
        mn_fail(source->st, MN_FAILED, "%s: cannot seek to byte %llu: %s", source->name,
                (unsigned long long)offset, strerror(errno));
    source->at = source->end = source->buffer;
    source->buffer[0] = 0;
    source->offset = offset;
    source->over = source->st->code != MN_OK;
    source->line = 1;
}

/* ---- words ---------------------------------------------------------------------------------- */

static bool is_blank(char c) {
    return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}

/* Is at a backslash that ends its line? Takes both when it does. */
static bool take_continuation(mni_source *source) {
    if (*source->at != '\\' || !mni_source_have(source, 2))
        return false;
    const char *p = source->at + 1;
    if (*p == '\r' && mni_source_have(source, 3))
        p = source->at + 2;
    if (*p != '\n')
        return false;
    source->at = p + 1;
    source->line++;
    return true;
}

bool mni_text_next(mni_source *source, bool continued) {
    for (;;) {
        while (is_blank(*source->at))
            source->at++;
        if (source->at == source->end) {
            if (!mni_source_fill(source, 1))
                return false;
        } else if (*source->at == '\n') {
            return false;
        } else if (!continued || !take_continuation(source)) {
            return true;
        }
    }
}

bool mni_text_skip_line(mni_source *source, bool continued) {
    char before[2] = {0, 0}; /* the line's end, kept across the window's moves */
    for (;;) {
        size_t left = (size_t)(source->end - source->at);
        const char *newline = memchr(source->at, '\n', left);
        const char *stop = newline != NULL ? newline : source->end;
        size_t taken = (size_t)(stop - source->at);
        if (taken >= 2) {
            before[0] = stop[-2];
            before[1] = stop[-1];
        } else if (taken == 1) {
            before[0] = before[1];
            before[1] = stop[-1];
        }
        source->at = stop;
        if (newline == NULL) {
            if (!mni_source_fill(source, 1))
                return false;
            continue;
        }
        source->at++;
        source->line++;
        bool joined = before[1] == '\\' || (before[0] == '\\' && before[1] == '\r');
        if (!continued || !joined)
            return true;
        before[0] = before[1] = 0;
    }
}

bool mni_text_next_anywhere(mni_source *source, char comment) {
    for (;;) {
        if (mni_text_next(source, false) && (comment == 0 || *source->at != comment))
            return true;
        if (!mni_text_skip_line(source, false))
            return false;
    }
}

static bool is_word_end(char c) {
    return c == 0 || c == '\n' || c == '\\' || is_blank(c);
}

bool mni_text_take(mni_source *source, const char *word) {
    size_t length = strlen(word);
    mni_source_have(source, MNI_WORD_BYTES_MAX);
    if ((size_t)(source->end - source->at) < length || strncasecmp(source->at, word, length) != 0 ||
        !is_word_end(source->at[length]))
        return false;
    source->at += length;
    return true;
}

bool mni_text_at_word_end(const mni_source *source) {
    return is_word_end(*source->at);
}

const char *mni_text_peek(mni_source *source, char *word, size_t size) {
    mni_source_have(source, MNI_WORD_BYTES_MAX);
    size_t length = 0;
    for (const char *p = source->at; p < source->end && length + 1 < size; p++) {
        if (*p == '\n' || is_blank(*p))
            break;
        word[length++] = isprint((unsigned char)*p) ? *p : '?';
    }
    word[length] = 0;
    return word;
}

void mni_text_word(mni_source *source, char *word, size_t size) {
    mni_text_peek(source, word, size);
    while (source->at < source->end && *source->at != '\n' && !is_blank(*source->at)) {
        source->at++;
        if (source->at == source->end)
            mni_source_fill(source, 1);
    }
}

/* ---- numbers -------------------------------------------------------------------------------- */

enum { EXPONENT_FAR = 9999, EXACT_EXPONENT = 27, DOUBLE_EXPONENT = 22, DIGITS_MAX = 19 };

static const double power_of_ten[DOUBLE_EXPONENT + 1] = {
    1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
    1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

#if LDBL_MANT_DIG == 64 && FLT_EVAL_METHOD == 0
static const long double long_power_of_ten[EXACT_EXPONENT + 1] = {
    1e0L,  1e1L,  1e2L,  1e3L,  1e4L,  1e5L,  1e6L,  1e7L,  1e8L,  1e9L,
    1e10L, 1e11L, 1e12L, 1e13L, 1e14L, 1e15L, 1e16L, 1e17L, 1e18L, 1e19L,
    1e20L, 1e21L, 1e22L, 1e23L, 1e24L, 1e25L, 1e26L, 1e27L};

/* mantissa × 10^exponent with one rounding to 64 bits (both operands are exact in them), then one
 * to 53. The two together err only when the 64-bit result is exactly half way between doubles. */
static bool scale_long(uint64_t mantissa, int exponent, double *value) {
    if (exponent < -EXACT_EXPONENT || exponent > EXACT_EXPONENT)
        return false;
    long double scaled = exponent < 0 ? (long double)mantissa / long_power_of_ten[-exponent]
                                      : (long double)mantissa * long_power_of_ten[exponent];
    uint64_t bits; /* the explicit 64-bit mantissa comes first */
    memcpy(&bits, &scaled, sizeof bits);
    if ((bits & 0x7ff) == 0x400)
        return false;
    *value = (double)scaled;
    return true;
}
#else
static bool scale_long(uint64_t mantissa, int exponent, double *value) {
    (void)mantissa, (void)exponent, (void)value;
    return false;
}
#endif

static bool scale(uint64_t mantissa, int exponent, double *value) {
    if (mantissa <= (UINT64_C(1) << 53) && exponent >= -DOUBLE_EXPONENT &&
        exponent <= DOUBLE_EXPONENT) { /* both exact: one operation rounds once */
        *value = exponent < 0 ? (double)mantissa / power_of_ten[-exponent]
                              : (double)mantissa * power_of_ten[exponent];
        return true;
    }
    return scale_long(mantissa, exponent, value);
}

static const char *exponent_of(const char *p, int *exponent) {
    bool negative = *p == '-';
    if (*p == '-' || *p == '+')
        p++;
    if (*p < '0' || *p > '9')
        return NULL;
    int value = 0;
    for (; *p >= '0' && *p <= '9'; p++)
        if (value < EXPONENT_FAR)
            value = value * 10 + (*p - '0');
    *exponent += negative ? -value : value;
    return p;
}

/* The number at p, by integer arithmetic. NULL: not decided here. */
static const char *parse_fast(const char *p, double *value) {
    bool negative = *p == '-';
    if (*p == '-' || *p == '+')
        p++;
    const char *first = p;
    uint64_t mantissa = 0;
    int exponent = 0;
    for (; *p >= '0' && *p <= '9'; p++)
        mantissa = mantissa * 10 + (uint64_t)(*p - '0');
    ptrdiff_t digits = p - first;
    if (*p == '.') {
        const char *point = ++p;
        for (; *p >= '0' && *p <= '9'; p++)
            mantissa = mantissa * 10 + (uint64_t)(*p - '0');
        exponent = (int)(point - p);
        digits += p - point;
    }
    if (digits == 0 || digits > DIGITS_MAX)
        return NULL;
    if (*p == 'e' || *p == 'E') {
        p = exponent_of(p + 1, &exponent);
        if (p == NULL)
            return NULL;
    }
    if (mantissa == 0)
        *value = 0;
    else if (!scale(mantissa, exponent, value))
        return NULL;
    if (negative)
        *value = -*value;
    return p;
}

static bool number_expected(mni_source *source, const char *what) {
    char word[40];
    if (source->at == source->end)
        return mni_source_fail(source, "the file ends where %s should stand", what);
    if (*source->at == '\n')
        return mni_source_fail(source, "the line ends where %s should stand", what);
    return mni_source_fail(source, "%s is '%s': a number is wanted", what,
                           mni_text_peek(source, word, sizeof word));
}

/* Long, tiny, huge or special numbers: "nan" and "inf" are numbers (their vertices are rejected
 * later, by face), hexadecimal ones are not. */
static bool double_slow(mni_source *source, double *value, const char *what) {
    const char *p = source->at;
    if (*p == '-' || *p == '+')
        p++;
    bool special = *p == 'n' || *p == 'N' || *p == 'i' || *p == 'I';
    bool digits = (*p >= '0' && *p <= '9') || *p == '.';
    if (!(special || digits) || (*p == '0' && (p[1] == 'x' || p[1] == 'X')))
        return number_expected(source, what);
    char *stop;
    *value = strtod_l(source->at, &stop, source->c_locale);
    if (stop == source->at || !is_word_end(*stop) || stop - source->at > MNI_WORD_BYTES_MAX)
        return number_expected(source, what);
    source->at = stop;
    return true;
}

bool mni_text_double(mni_source *source, double *value, const char *what) {
    mni_source_have(source, MNI_WORD_BYTES_MAX);
    const char *stop = parse_fast(source->at, value);
    if (stop == NULL || !is_word_end(*stop) || (stop == source->end && !source->over))
        return double_slow(source, value, what);
    source->at = stop;
    return true;
}

bool mni_text_digits(mni_source *source, int64_t *value) {
    mni_source_have(source, MNI_WORD_BYTES_MAX);
    const char *p = source->at;
    bool negative = *p == '-';
    if (*p == '-' || *p == '+')
        p++;
    const char *first = p;
    uint64_t magnitude = 0;
    for (; *p >= '0' && *p <= '9' && p - first < DIGITS_MAX; p++)
        magnitude = magnitude * 10 + (uint64_t)(*p - '0');
    if (p == first || (*p >= '0' && *p <= '9') || magnitude > INT64_MAX)
        return false;
    *value = negative ? -(int64_t)magnitude : (int64_t)magnitude;
    source->at = p;
    return true;
}

bool mni_text_integer(mni_source *source, int64_t *value, const char *what) {
    mni_source_have(source, MNI_WORD_BYTES_MAX); /* so that the window stays where it is */
    const char *from = source->at;
    if (mni_text_digits(source, value) && is_word_end(*source->at))
        return true;
    source->at = from;
    if (source->at == source->end || *source->at == '\n')
        return number_expected(source, what);
    char word[40];
    return mni_source_fail(source, "%s is '%s': an integer is wanted", what,
                           mni_text_peek(source, word, sizeof word));
}
