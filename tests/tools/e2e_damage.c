/* e2e_damage FILE STEP …: changes a .mnt or .vdt in place, and makes its checksums good again when
 * told to, so that what lies behind them is tried too.
 *
 *   put OFFSET TYPE VALUE   u8, u16, u32, u64, f32 or f64 at a byte
 *   add OFFSET VALUE        to the u32 there, modulo 2^32
 *   seal                    the header's checksum (of a .vdt: those of its sections and its build
 *                           id first)
 *   seal-block ID           a block's checksum
 *   blocks                  prints a line a block: id pages kind refs payload parent, where payload
 *                           is the byte of the file at which it begins (.mnt)
 *
 * Layouts are those of docs/format.md. For the end-to-end scripts; exit 1 and a line when a step
 * makes no sense. One thread; memory: the file. */
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "frame.h"

enum { CHECKSUM_AT = 16, VDT_BYTES = 288, VDT_SECTIONS_AT = 240, VDT_SECTIONS = 2 };

typedef struct section {
    uint64_t offset, bytes, checksum;
} section;

static const char *name;
static unsigned char *bytes;
static uint64_t size;

static void die(const char *why, const char *what) {
    fprintf(stderr, "e2e_damage: %s: %s %s\n", name, why, what);
    exit(1);
}

static void *at(uint64_t offset, uint64_t count) {
    if (offset > size || count > size - offset)
        die("outside the file:", "a step");
    return bytes + offset;
}

static uint32_t u32_at(uint64_t offset) {
    uint32_t value;
    memcpy(&value, at(offset, sizeof value), sizeof value);
    return value;
}

static bool is_vdt(void) {
    return memcmp(at(0, 5), "MNVDT", 5) == 0;
}

static void put(uint64_t offset, const char *type, const char *text) {
    if (strcmp(type, "f32") == 0) {
        float value = strtof(text, NULL);
        memcpy(at(offset, sizeof value), &value, sizeof value);
    } else if (strcmp(type, "f64") == 0) {
        double value = strtod(text, NULL);
        memcpy(at(offset, sizeof value), &value, sizeof value);
    } else { /* little-endian: the low bytes come first */
        uint64_t value = strtoull(text, NULL, 0);
        size_t count = strcmp(type, "u8") == 0    ? 1
                       : strcmp(type, "u16") == 0 ? 2
                       : strcmp(type, "u32") == 0 ? 4
                                                  : 8;
        if (count == 8 && strcmp(type, "u64") != 0)
            die("no type", type);
        memcpy(at(offset, count), &value, count);
    }
}

/* Of a .vdt whose sections have been summed. */
static uint64_t build_id(void) {
    static const uint64_t from[6] = {40, 44, 48, 52, 60, 68}; /* leaves … metric */
    unsigned char said[88] = {0};
    for (int i = 0; i < 6; i++)
        memcpy(said + 4 * i, at(from[i], 4), 4);
    memcpy(said + 24, at(72, 4), 4);   /* flags: colours */
    memcpy(said + 40, at(80, 24), 24); /* origin */
    memcpy(said + 64, at(76, 4), 4);   /* grid_step */
    for (uint64_t i = 0; i < VDT_SECTIONS; i++)
        memcpy(said + 72 + 8 * i, at(VDT_SECTIONS_AT + i * sizeof(section) + 16, 8), 8);
    return XXH3_64bits(said, sizeof said);
}

static void seal(void) {
    uint64_t count = is_vdt() ? VDT_BYTES : MN_PAGE_BYTES, checksum = 0;
    for (uint64_t i = 0; is_vdt() && i < VDT_SECTIONS; i++) {
        uint64_t where = VDT_SECTIONS_AT + i * sizeof(section);
        section s;
        memcpy(&s, at(where, sizeof s), sizeof s);
        if (s.offset <= size && s.bytes <= size - s.offset)
            s.checksum = XXH3_64bits(bytes + s.offset, s.bytes);
        memcpy(bytes + where, &s, sizeof s);
    }
    if (is_vdt()) {
        uint64_t id = build_id();
        memcpy(at(24, sizeof id), &id, sizeof id);
    }
    memcpy(at(CHECKSUM_AT, sizeof checksum), &checksum, sizeof checksum);
    checksum = XXH3_64bits(at(0, count), count);
    memcpy(bytes + CHECKSUM_AT, &checksum, sizeof checksum);
}

/* The length is what the frame says, or, where that has been damaged, what is left of the file. */
static void seal_block(uint64_t id) {
    uint64_t offset = id * MN_PAGE_BYTES, length = (uint64_t)u32_at(offset + 28) * MN_PAGE_BYTES;
    at(offset, MN_PAGE_BYTES);
    if (length == 0 || length > size - offset)
        length = MN_PAGE_BYTES;
    uint64_t seed; /* magic and kind */
    memcpy(&seed, bytes + offset, sizeof seed);
    uint64_t checksum = XXH3_64bits_withSeed(bytes + offset + 16, length - 16, seed);
    memcpy(bytes + offset + 8, &checksum, sizeof checksum);
}

static void list_blocks(void) {
    for (uint64_t offset = MN_PAGE_BYTES; offset < size;) {
        uint32_t kind = u32_at(offset + 4), pages = u32_at(offset + 28), refs = u32_at(offset + 32);
        printf("%" PRIu64 " %u %u %u %" PRIu64 " %u\n", offset / MN_PAGE_BYTES, pages, kind, refs,
               offset + mni_frame_payload_at(refs), u32_at(offset + 40));
        if (u32_at(offset) != MNI_FRAME_MAGIC || pages == 0)
            die("no block where one should begin:", "blocks");
        offset += (uint64_t)pages * MN_PAGE_BYTES;
    }
}

static int step(char **word) { /* the words that it took */
    if (strcmp(word[0], "seal") == 0)
        return seal(), 1;
    if (strcmp(word[0], "blocks") == 0)
        return list_blocks(), 1;
    if (strcmp(word[0], "seal-block") == 0 && word[1] != NULL)
        return seal_block(strtoull(word[1], NULL, 0)), 2;
    if (strcmp(word[0], "add") == 0 && word[1] != NULL && word[2] != NULL) {
        uint64_t offset = strtoull(word[1], NULL, 0);
        uint32_t value = u32_at(offset) + (uint32_t)strtoll(word[2], NULL, 0);
        memcpy(at(offset, sizeof value), &value, sizeof value);
        return 3;
    }
    if (strcmp(word[0], "put") == 0 && word[1] != NULL && word[2] != NULL && word[3] != NULL)
        return put(strtoull(word[1], NULL, 0), word[2], word[3]), 4;
    die("no step", word[0]);
    return 0;
}

int main(int argc, char **argv) {
    name = argc > 1 ? argv[1] : "";
    FILE *f = fopen(name, "r+be");
    if (f == NULL || fseek(f, 0, SEEK_END) != 0)
        die("cannot be", "opened");
    size = (uint64_t)ftell(f);
    bytes = malloc(size + 1);
    rewind(f);
    if (bytes == NULL || fread(bytes, 1, size, f) != size)
        die("cannot be", "read");
    for (int i = 2; i < argc;)
        i += step(argv + i);
    rewind(f);
    bool good = fwrite(bytes, 1, size, f) == size;
    free(bytes);
    return fclose(f) == 0 && good ? 0 : 1;
}
