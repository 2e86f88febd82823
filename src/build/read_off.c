/* OFF and its kin: [ST][C][N]OFF, ascii.
 *
 * Secret: the grammar. After the keyword come the numbers of vertices, faces and (perhaps) edges,
 * then a vertex a line (x y z, with N a normal, with C a colour, with ST two more numbers), then a
 * face a line: how many corners, the corners, and perhaps a colour, which is passed over. '#'
 * begins a comment. Colours follow the rule of mni_read_color. Order: one call. Memory: none. */
#include "reader.h"

#include <inttypes.h>
#include <string.h>

enum { NORMAL_VALUES = 3, TEXTURE_VALUES = 2, COLOR_VALUES = 4 };

typedef struct off {
    mni_source *source;
    mni_intake *intake;
    bool colors, normals, textures;
    uint64_t vertices, faces;
    double color_max;
} off;

/* Goes to the next word of this line; a comment ends the line. */
static bool next_word(off *o) {
    return mni_text_next(o->source, false) && *o->source->at != '#';
}

static bool read_keyword(off *o) {
    char keyword[16];
    const char *p = keyword;
    mni_text_word(o->source, keyword, sizeof keyword);
    o->textures = strncmp(p, "ST", 2) == 0;
    p += o->textures ? 2 : 0;
    o->colors = *p == 'C';
    p += o->colors;
    o->normals = *p == 'N';
    p += o->normals;
    if (*p == '4' || *p == 'n')
        return mni_source_fail(o->source,
                               "%s has vertices of other than three dimensions: "
                               "only OFF, COFF, NOFF, CNOFF and ST… are read",
                               keyword);
    if (next_word(o) && mni_text_take(o->source, "BINARY"))
        return mni_source_fail(o->source, "binary OFF is not read: write it as ascii");
    return true;
}

static bool read_count(off *o, uint64_t *count, const char *what) {
    int64_t value;
    mni_text_next(o->source, false);
    if (!mni_text_integer(o->source, &value, what))
        return false;
    *count = (uint64_t)value;
    return value >= 0 || mni_source_fail(o->source, "%s is %" PRId64, what, value);
}

/* Takes the line of counts and holds them against what the file has room for: at least "0 0 0\n"
 * a vertex and "0\n" a face. */
static bool read_counts(off *o) {
    if (!mni_text_next_anywhere(o->source, '#'))
        return mni_source_fail(o->source, "the file ends where its counts should stand");
    if (!read_count(o, &o->vertices, "the number of vertices") ||
        !read_count(o, &o->faces, "the number of faces"))
        return false;
    mni_text_skip_line(o->source, false);
    uint64_t left = mni_source_left(o->source) + 1;
    if (o->vertices > left / 6 || o->faces > (left - 6 * o->vertices) / 2)
        return mni_source_fail(o->source,
                               "%" PRIu64 " vertices and %" PRIu64 " faces cannot be: %" PRIu64
                               " bytes are left in the file",
                               o->vertices, o->faces, left - 1);
    return true;
}

static bool next_line(off *o, const char *what, uint64_t number, uint64_t count) {
    return mni_text_next_anywhere(o->source, '#') ||
           mni_source_fail(o->source, "the file ends before %s %" PRIu64 " of %" PRIu64, what,
                           number, count);
}

/* What follows a vertex's position and normal; *rgba stays where there is no colour. */
static bool read_color(off *o, uint64_t number, uint32_t *rgba) {
    double value[COLOR_VALUES + TEXTURE_VALUES];
    int count = 0;
    while (count < COLOR_VALUES + TEXTURE_VALUES && next_word(o))
        if (!mni_text_double(o->source, &value[count++], "a colour"))
            return false;
    count -= o->textures ? TEXTURE_VALUES : 0;
    if (count < 3)
        return mni_source_fail(o->source, "vertex %" PRIu64 " has no colour", number);
    *rgba = mni_read_color(value, count < COLOR_VALUES ? count : COLOR_VALUES, &o->color_max);
    return true;
}

static bool read_vertex(off *o, uint64_t number) {
    double value[3 + NORMAL_VALUES];
    uint32_t rgba = MNI_WHITE;
    if (!next_line(o, "vertex", number, o->vertices))
        return false;
    for (int i = 0; i < (o->normals ? 6 : 3); i++) {
        mni_text_next(o->source, false);
        if (!mni_text_double(o->source, &value[i], "a coordinate"))
            return false;
    }
    if (o->colors && !read_color(o, number, &rgba))
        return false;
    mni_text_skip_line(o->source, false);
    return mni_intake_vertex_color(o->intake, value, rgba);
}

static bool read_face(off *o, uint64_t number) {
    mni_polygon polygon = {0};
    uint64_t corners;
    if (!next_line(o, "face", number, o->faces) ||
        !read_count(o, &corners, "the number of corners"))
        return false;
    for (uint64_t i = 0; i < corners; i++) {
        int64_t vertex;
        mni_text_next(o->source, false);
        if (!mni_text_integer(o->source, &vertex, "a corner"))
            return false;
        if (vertex < 0 || (uint64_t)vertex >= o->vertices)
            return mni_read_out_of_range(o->source, "face", number, vertex, o->vertices);
        if (!mni_polygon_corner(&polygon, o->intake, (uint32_t)vertex))
            return false;
    }
    mni_text_skip_line(o->source, false);
    return mni_polygon_end(&polygon, o->intake);
}

bool mni_read_off(mni_source *source, mni_intake *intake) {
    off o = {.source = source, .intake = intake, .color_max = 1};
    source->text = true;
    if (!read_keyword(&o) || !read_counts(&o) || !mni_intake_expect(intake, o.vertices, o.faces))
        return false;
    for (uint64_t i = 0; i < o.vertices; i++)
        if (!read_vertex(&o, i + 1))
            return false;
    for (uint64_t i = 0; i < o.faces; i++)
        if (!read_face(&o, i + 1))
            return false;
    return !mni_text_next_anywhere(source, '#') ||
           mni_source_fail(source, "the file goes on after all that its header counts");
}
