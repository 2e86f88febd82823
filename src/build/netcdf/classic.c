/* See classic.h. The header, big-endian, names and values padded to four bytes, count and size u32,
 * or u64 in CDF-5:
 *
 *   "CDF" version u8, records count
 *   list of dimensions   name, length count (0: grows by records)
 *   list of attributes   name, type u32, values
 *   list of variables    name, dimensions …, list of attributes, type u32, size, begin
 *
 * where a list is tag u32, count, items; begin is u32 in CDF-1, else u64. Memory: the lengths of
 * some dimensions. */
#include "classic.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

enum { DIMENSIONS_MAX = 64 };

typedef struct header {
    FILE *file;
    int version;
    bool cut;
    uint64_t length[DIMENSIONS_MAX]; /* of the first ones; others count as growing */
} header;

static uint64_t number(header *h, int bytes) {
    uint64_t x = 0;
    for (int i = 0; i < bytes; i++) {
        int c = fgetc(h->file);
        h->cut |= c == EOF;
        x = x << 8 | (uint64_t)(c & 0xff);
    }
    return x;
}

static uint64_t count(header *h) {
    return number(h, h->version == 5 ? 8 : 4);
}

static void skip(header *h, uint64_t bytes) {
    h->cut |= bytes > INT64_MAX / 2 || fseeko(h->file, (off_t)((bytes + 3) / 4 * 4), SEEK_CUR) != 0;
}

static uint64_t type_bytes(uint64_t type) {
    static const uint8_t bytes[] = {0, 1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8};
    return type < sizeof bytes ? bytes[type] : 0;
}

static uint64_t list(header *h) {
    number(h, 4);
    return count(h);
}

static void skip_attributes(header *h) {
    for (uint64_t n = list(h); n > 0 && !h->cut; n--) {
        skip(h, count(h));
        uint64_t bytes = type_bytes(number(h, 4)), values = count(h);
        h->cut |= values > INT64_MAX / 16;
        if (!h->cut)
            skip(h, bytes * values);
    }
}

/* One variable of the list; returns where it ends. */
static uint64_t variable_end(header *h) {
    uint64_t elements = 1;
    skip(h, count(h));
    for (uint64_t n = count(h); n > 0 && !h->cut; n--) {
        uint64_t dimension = count(h);
        uint64_t length = dimension < DIMENSIONS_MAX ? h->length[dimension] : 0;
        if (length == 0 || elements > INT64_MAX / 16 / length)
            elements = 0;
        elements *= length;
    }
    skip_attributes(h);
    uint64_t bytes = type_bytes(number(h, 4)) * elements;
    count(h);
    uint64_t begin = number(h, h->version == 1 ? 4 : 8);
    return h->cut || bytes == 0 || begin > INT64_MAX ? UINT64_MAX : begin + bytes;
}

static uint64_t header_end(header *h, int variable) {
    char magic[3];
    if (fread(magic, 3, 1, h->file) != 1 || memcmp(magic, "CDF", 3) != 0)
        return 0;
    h->version = fgetc(h->file);
    if (h->version != 1 && h->version != 2 && h->version != 5)
        return 0;
    count(h);
    uint64_t dimensions = list(h);
    for (uint64_t i = 0; i < dimensions && !h->cut; i++) {
        skip(h, count(h));
        uint64_t length = count(h);
        if (i < DIMENSIONS_MAX)
            h->length[i] = length;
    }
    skip_attributes(h);
    uint64_t variables = list(h), end = UINT64_MAX;
    for (uint64_t i = 0; i <= (uint64_t)variable && i < variables && !h->cut; i++)
        end = variable_end(h);
    return h->cut ? UINT64_MAX : end;
}

uint64_t classic_end(const char *path, int variable) {
    header h = {.file = fopen(path, "rb")};
    if (h.file == NULL)
        return UINT64_MAX;
    uint64_t end = header_end(&h, variable);
    fclose(h.file);
    return end;
}
