/* From a path to a mesh: which format it is, its reader, the intake.
 *
 * Secret: how a format is known. Content decides, never the name: magics first, then the equation
 * of a binary STL (84 + 50 n bytes; its header may begin with "solid" or anything), then words.
 * What is none of these and is text is tried as OBJ, whose reader knows when it is not.
 * Threads: any, each call on its own. Memory: the intake's, and what the mesh owns. */
#include "metanode/build.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "clock.h"
#include "extintake.h"
#include "reader.h"

enum { SNIFF_BYTES = 4096, STL_HEAD_BYTES = 84, STL_FACET_BYTES = 50 };

typedef enum format { UNKNOWN, PLY, OFF, STL_BINARY, STL_ASCII, OPENMESH, OBJ } format;

static bool is_space(char c) {
    return c == ' ' || (c >= '\t' && c <= '\r');
}

/* Does the text begin with that word, blank or end after it? */
static bool begins(const mni_source *source, const char *word) {
    size_t length = strlen(word);
    size_t left = (size_t)(source->end - source->at);
    return left >= length && strncasecmp(source->at, word, length) == 0 &&
           (left == length || is_space(source->at[length]));
}

/* [ST][C][N][4][n]OFF; the reader refuses the kinds that it does not know. */
static bool begins_off(const mni_source *source) {
    const char *p = source->at;
    p += strncmp(p, "ST", 2) == 0 ? 2 : 0;
    p += *p == 'C';
    p += *p == 'N';
    p += *p == '4';
    p += *p == 'n';
    return strncmp(p, "OFF", 3) == 0 && (p[3] == 0 || p[3] == '#' || is_space(p[3]));
}

static uint64_t stl_facets(const mni_source *source) {
    uint32_t facets;
    memcpy(&facets, source->at + STL_HEAD_BYTES - sizeof facets, sizeof facets);
    return facets;
}

static format format_of(mni_source *source) {
    mni_source_have(source, SNIFF_BYTES);
    size_t left = (size_t)(source->end - source->at);
    if (left >= 4 && memcmp(source->at, "ply", 3) == 0 && is_space(source->at[3]))
        return PLY;
    if (left >= 4 && memcmp(source->at, "OM", 2) == 0 && memchr("TQP", source->at[2], 3) != NULL)
        return OPENMESH;
    if (left >= STL_HEAD_BYTES &&
        source->size == STL_HEAD_BYTES + STL_FACET_BYTES * stl_facets(source))
        return STL_BINARY;
    size_t sniffed = left < SNIFF_BYTES ? left : SNIFF_BYTES;
    if (memchr(source->at, 0, sniffed) != NULL)
        return UNKNOWN;
    if (left >= 3 && memcmp(source->at, "\xef\xbb\xbf", 3) == 0)
        source->at += 3; /* a byte-order mark of UTF-8 */
    mni_text_next_anywhere(source, '#');
    mni_source_have(source, MNI_WORD_BYTES_MAX);
    if (begins_off(source))
        return OFF;
    return begins(source, "solid") ? STL_ASCII : OBJ;
}

/* A file of ours, which is past being read as a mesh. */
static bool refuse_own(mni_source *source, const char *what) {
    mn_fail(source->st, MN_BAD_INPUT, "%s: is %s", source->name, what);
    return false;
}

/* Models are often handed on compressed. NULL: not by anything known. */
static const char *compressed_by(const mni_source *source) {
    static const struct {
        const char *name, *magic;
        size_t bytes;
    } known[] = {{"gzip", "\x1f\x8b", 2},
                 {"bzip2", "BZh", 3},
                 {"xz",
                  "\xfd"
                  "7zXZ",
                  5},
                 {"zstd", "\x28\xb5\x2f\xfd", 4},
                 {"zip", "PK\3\4", 4}};
    const size_t left = (size_t)(source->end - source->at);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (left >= known[i].bytes && memcmp(source->at, known[i].magic, known[i].bytes) == 0)
            return known[i].name;
    return NULL;
}

/* A binary STL whose length is wrong: it says so itself, or is not too far off. */
static bool may_be_stl(const mni_source *source) {
    enum { FACTOR = 64 };
    const uint64_t wanted = STL_HEAD_BYTES + STL_FACET_BYTES * stl_facets(source);
    const size_t name = strlen(source->name);
    return memcmp(source->at, "solid", 5) == 0 ||
           (name >= 4 && strcasecmp(source->name + name - 4, ".stl") == 0) ||
           (wanted / FACTOR <= source->size && source->size / FACTOR <= wanted);
}

/* No text and no magic: at best a binary STL of the wrong length. */
static bool refuse_unknown(mni_source *source) {
    char hint[160] = "";
    const size_t left = (size_t)(source->end - source->at);
    const char *packed = compressed_by(source);
    if (left >= 8 && memcmp(source->at, "MNTREE\r\n", 8) == 0)
        return refuse_own(source, "a .mnt, which is built already: metanode block cuts it in "
                                  "another way, extract makes a mesh of it");
    if (left >= 8 && memcmp(source->at, "MNVDT\0\r\n", 8) == 0)
        return refuse_own(source, "a .vdt, which is simplified already: metanode block makes a "
                                  ".mnt of it, extract a mesh");
    if (packed != NULL) {
        mn_fail(source->st, MN_BAD_INPUT, "%s: is compressed (%s): unpack it first", source->name,
                packed);
        return false;
    }
    if (left >= STL_HEAD_BYTES && may_be_stl(source))
        snprintf(hint, sizeof hint,
                 " (as a binary STL of %" PRIu64 " facets it would have %" PRIu64
                 " bytes; it has %" PRIu64 ")",
                 stl_facets(source), STL_HEAD_BYTES + STL_FACET_BYTES * stl_facets(source),
                 source->size);
    mn_fail(source->st, MN_BAD_INPUT,
            "%s: not a mesh file that is known here: PLY, STL, OBJ, OFF and OM are%s", source->name,
            hint);
    return false;
}

static bool read_own(format kind, mni_source *source, mni_intake *intake) {
    switch (kind) {
    case PLY:
        return mni_read_ply(source, intake);
    case OFF:
        return mni_read_off(source, intake);
    case STL_BINARY:
        return mni_read_stl_binary(source, intake);
    case STL_ASCII:
        return mni_read_stl_ascii(source, intake);
    case OBJ:
        return mni_read_obj(source, intake);
    case OPENMESH:
    case UNKNOWN:
        break;
    }
    return refuse_unknown(source);
}

bool mni_read_out_of_range(mni_source *source, const char *element, uint64_t number, int64_t vertex,
                           uint64_t vertices) {
    return mni_source_fail(source, "%s %" PRIu64 ": vertex %" PRId64 " of %" PRIu64, element,
                           number, vertex, vertices);
}

uint32_t mni_read_channel(double value) {
    if (!(value > 0))
        return 0;
    return value >= 1 ? 255 : (uint32_t)(value * 255 + 0.5);
}

uint32_t mni_read_color(const double *channel, int channels, double *max) {
    uint32_t rgba = 0;
    for (int i = 0; i < channels; i++)
        if (channel[i] > 1)
            *max = 255;
    for (int i = 0; i < 4; i++)
        rgba |= (i < channels ? mni_read_channel(channel[i] / *max) : UINT32_C(255)) << 8 * i;
    return rgba;
}

/* Pushes the file's mesh into the intake. */
static bool push(const char *path, format kind, bool openmesh, mni_source *source,
                 const mn_read_desc *desc, mni_intake *intake) {
    static const char *const openmesh_names[] = {
        [PLY] = "ply",       [OFF] = "off",     [STL_BINARY] = "stl",
        [STL_ASCII] = "stl", [OPENMESH] = "om", [OBJ] = "obj"};
    return (openmesh ? mni_read_openmesh(path, openmesh_names[kind], desc, source, intake)
                     : read_own(kind, source, intake)) &&
           source->st->code == MN_OK && mni_source_unchanged(source);
}

/* Into one of the two. */
static bool read_source(const char *path, mni_source *source, const mn_read_desc *desc,
                        const mni_extmesh_desc *external, mn_mesh *out, mni_extmesh *out_external) {
    format kind = format_of(source);
    if (source->st->code != MN_OK)
        return false;
    bool openmesh = kind == OPENMESH || (desc->reader == MN_READER_OPENMESH && kind != UNKNOWN);
    bool soup = !openmesh && (kind == STL_BINARY || kind == STL_ASCII), ok = false;
    mni_extintake *x = NULL;
    mni_intake *intake = NULL;
    if (external == NULL) {
        intake = mni_intake_open(desc, soup, source->name, source->st);
        ok = intake != NULL && push(path, kind, openmesh, source, desc, intake) &&
             mni_intake_finish(intake, out);
    } else {
        const uint64_t most = 16 * source->size + (64 << 20); /* more is not used */
        mni_extmesh_desc bounded = *external;
        if (bounded.work_bytes > most)
            bounded.work_bytes = most;
        x = mni_extintake_open(&bounded, desc, soup, source->name, source->st);
        intake = x != NULL ? mni_intake_open_to(x, soup, source->name, source->st) : NULL;
        ok = intake != NULL && push(path, kind, openmesh, source, desc, intake) &&
             mni_extintake_finish(x, out_external);
    }
    mni_intake_close(intake);
    mni_extintake_close(x);
    return ok;
}

mn_code mni_extmesh_read(const char *path, const mn_read_desc *read, const mni_extmesh_desc *desc,
                         mni_extmesh *out, mn_status *st) {
    const mn_read_desc defaults = {0};
    mn_status own = {0};
    mni_source source;
    *out = (mni_extmesh){.vertex.fd = -1, .triangle.fd = -1};
    if (read == NULL)
        read = &defaults;
    if (mni_source_open(&source, path, read, &own))
        read_source(path, &source, read, desc, NULL, out);
    mni_source_close(&source);
    if (own.code != MN_OK)
        mn_fail(st, own.code, "%s", own.text);
    return own.code;
}

mn_code mn_mesh_read(const char *path, const mn_read_desc *desc, mn_mesh *out, mn_status *st) {
    const mn_read_desc defaults = {0};
    mn_status own = {0};
    double started_s = mni_now_s();
    mni_source source;
    *out = (mn_mesh){0};
    if (desc == NULL)
        desc = &defaults;
    if (mni_source_open(&source, path, desc, &own) &&
        read_source(path, &source, desc, NULL, out, NULL)) {
        out->bytes_read = source.size;
        out->seconds_read = mni_now_s() - started_s;
    }
    mni_source_close(&source);
    if (own.code != MN_OK)
        mn_fail(st, own.code, "%s", own.text);
    return own.code;
}

/* ---- what is to come ------------------------------------------------------------------------- */

enum {
    SAMPLES = 64,
    SAMPLE_BYTES = 16 << 10,
    OM_VERTEX_BYTES = 30, /* three floats, and the halves of three edges */
};

typedef struct line_counts {
    uint64_t vertices, faces, bytes; /* of whole lines */
} line_counts;

/* Lines of a piece of text, from behind its first line end to its last one. */
static void count_lines(const char *text, line_counts *counts) {
    const char *at = strchr(text, '\n'), *last = strrchr(text, '\n');
    for (; at != NULL && at < last; at = strchr(at + 1, '\n')) {
        const char *word = at + 1 + strspn(at + 1, " \t");
        const bool vertex = strncmp(word, "v ", 2) == 0 || strncmp(word, "v\t", 2) == 0 ||
                            strncasecmp(word, "vertex", 6) == 0;
        counts->vertices += vertex;
        counts->faces += strncmp(word, "f ", 2) == 0 || strncmp(word, "f\t", 2) == 0;
    }
    counts->bytes += at == NULL ? 0 : (uint64_t)(last - strchr(text, '\n'));
}

/* Formats that count nothing: by a megabyte of samples. */
static void expect_lines(const mni_source *source, mni_claims *claims) {
    line_counts counts = {0};
    const uint64_t last = source->size > SAMPLE_BYTES ? source->size - SAMPLE_BYTES : 0;
    for (uint64_t i = 0; i < SAMPLES; i++) {
        char text[SAMPLE_BYTES + 2] = "\n";
        ssize_t got =
            pread(source->fd, text + 1, SAMPLE_BYTES, (off_t)((double)last * i / (SAMPLES - 1)));
        text[got > 0 ? got + 1 : 1] = 0;
        count_lines(text, &counts);
    }
    const double times = counts.bytes > 0 ? (double)source->size / (double)counts.bytes : 0;
    claims->vertices = (uint64_t)(times * (double)counts.vertices);
    claims->triangles = (uint64_t)(times * (double)counts.faces);
}

/* Formats that do: their own readers', up to where the numbers are. */
static void hear_claims(format kind, mni_source *source, mni_claims *claims) {
    mni_intake *intake = mni_intake_open_claims(claims, source->name, source->st);
    if (intake != NULL)
        read_own(kind, source, intake);
    mni_intake_close(intake);
    if (claims->heard)
        *source->st = (mn_status){0};
}

mn_code mn_mesh_expect(const char *path, uint64_t *vertices, uint64_t *triangles, mn_status *st) {
    mn_status own = {0};
    mni_source source;
    mni_claims claims = {0};
    if (mni_source_open(&source, path, &(mn_read_desc){0}, &own)) {
        const format kind = format_of(&source);
        if (kind == OBJ || kind == STL_ASCII)
            expect_lines(&source, &claims);
        else if (kind == OPENMESH)
            claims.vertices = source.size / OM_VERTEX_BYTES;
        else
            hear_claims(kind, &source, &claims);
        if (kind == STL_ASCII)
            claims.triangles = claims.vertices / 3;
        else if (kind == STL_BINARY)
            claims.vertices = 3 * claims.triangles;
        else if (claims.triangles < 2 * claims.vertices)
            claims.triangles = 2 * claims.vertices;
    }
    mni_source_close(&source);
    *vertices = claims.vertices;
    *triangles = claims.triangles;
    if (own.code != MN_OK)
        mn_fail(st, own.code, "%s", own.text);
    return own.code;
}

void mn_mesh_free(mn_mesh *mesh) {
    free(mesh->position);
    free(mesh->color);
    free(mesh->corner);
    *mesh = (mn_mesh){0};
}
