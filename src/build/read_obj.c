/* Wavefront OBJ: vertices and faces; everything else is passed over.
 *
 * Secret: the grammar. A vertex is `v x y z`, `v x y z w` (w is dropped) or `v x y z r g b [a]`; a
 * face is `f` with corners v, v/vt, v//vn or v/vt/vn, counted from 1, or from the last vertex
 * backwards when negative. A face may name vertices that come later. Colours
 * follow the rule of mni_read_color. Order: one call. Memory: none. */
#include "reader.h"

#include <inttypes.h>

typedef struct obj {
    mni_source *source;
    mni_intake *intake;
    uint64_t faces;
    double color_max; /* 1 or 255 */
    /* the farthest vertex that a face named before it came: the first such face, where it stands */
    int64_t ahead; /* counted from 0; -1: none */
    uint64_t ahead_face, ahead_line;
} obj;

/* Goes to the next word of the statement; a comment ends it. */
static bool next_word(mni_source *source) {
    return mni_text_next(source, true) && *source->at != '#';
}

static bool read_vertex(obj *o) {
    double value[7];
    int count = 0;
    while (next_word(o->source)) {
        double extra;
        if (!mni_text_double(o->source, count < 7 ? &value[count] : &extra, "a coordinate"))
            return false;
        count += count < 7;
    }
    if (count < 3)
        return mni_source_fail(o->source, "vertex %" PRIu64 " has %d coordinates: 3 are wanted",
                               mni_intake_vertices(o->intake) + 1, count);
    if (count < 6)
        return mni_intake_vertex(o->intake, value);
    uint32_t rgba = mni_read_color(value + 3, count - 3, &o->color_max);
    return mni_intake_vertex_color(o->intake, value, rgba);
}

static bool bad_corner(obj *o) {
    char word[40];
    return mni_source_fail(o->source, "face %" PRIu64 ": '%s' where a corner should stand or end",
                           o->faces, mni_text_peek(o->source, word, sizeof word));
}

/* Takes one corner; *vertex counts from 0. */
static bool read_corner(obj *o, uint32_t *vertex) {
    mni_source *source = o->source;
    int64_t number, other;
    if (!mni_text_digits(source, &number))
        return bad_corner(o);
    for (int slashes = 0; slashes < 2 && *source->at == '/'; slashes++) {
        source->at++;
        mni_text_digits(source, &other); /* may be empty */
    }
    if (!mni_text_at_word_end(source))
        return bad_corner(o);
    int64_t known = (int64_t)mni_intake_vertices(o->intake);
    int64_t index = number < 0 ? known + number : number - 1;
    if (number == 0 || index < 0 || index >= (int64_t)MNI_VERTICES_MAX)
        return mni_read_out_of_range(source, "face", o->faces, number, (uint64_t)known);
    if (index >= known && index > o->ahead) {
        o->ahead = index;
        o->ahead_face = o->faces;
        o->ahead_line = source->line;
    }
    *vertex = (uint32_t)index;
    return true;
}

static bool read_face(obj *o) {
    mni_polygon polygon = {0};
    o->faces++;
    while (next_word(o->source)) {
        uint32_t vertex = 0;
        if (!read_corner(o, &vertex) || !mni_polygon_corner(&polygon, o->intake, vertex))
            return false;
    }
    return mni_polygon_end(&polygon, o->intake);
}

/* Is the word at hand this one letter? Takes it then. Alone on its line it counts too: skipped, it
 * would shift all that is numbered after it. */
static bool take_keyword(mni_source *source, char keyword) {
    char after = mni_source_have(source, 2) ? source->at[1] : '\n';
    if (source->at[0] != keyword ||
        !(after == ' ' || after == '\t' || after == '\r' || after == '\n'))
        return false;
    source->at++;
    return true;
}

bool mni_read_obj(mni_source *source, mni_intake *intake) {
    obj o = {.source = source, .intake = intake, .color_max = 1, .ahead = -1};
    source->text = true;
    while (mni_text_next_anywhere(source, '#')) {
        if (take_keyword(source, 'v')) {
            if (!read_vertex(&o))
                return false;
        } else if (take_keyword(source, 'f')) {
            if (!read_face(&o))
                return false;
        }
        bool comment = *source->at == '#'; /* a backslash at its end joins nothing */
        if (!mni_text_skip_line(source, !comment))
            break;
    }
    uint64_t vertices = mni_intake_vertices(intake);
    if (source->st->code != MN_OK)
        return false;
    if (vertices == 0 && o.faces == 0) {
        mn_fail(source->st, MN_BAD_INPUT,
                "%s: not a mesh file that is known here: PLY, STL, OBJ, OFF and OM are",
                source->name);
        return false;
    }
    if (o.ahead >= (int64_t)vertices) {
        source->line = o.ahead_line;
        return mni_read_out_of_range(source, "face", o.ahead_face, o.ahead + 1, vertices);
    }
    return true;
}
