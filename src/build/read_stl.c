/* STL, binary and ascii: a soup of triangles, welded by the intake.
 *
 * Secret: the two layouts. Which of them it is has been decided before, by the equation of the
 * binary one. A facet's normal is never used: it is often 0 or wrong, and the corners' order says
 * the same. Order: one call. Memory: none. */
#include "reader.h"

#include <inttypes.h>
#include <string.h>

enum { HEAD_BYTES = 84, FACET_BYTES = 50, NORMAL_BYTES = 12 };

bool mni_read_stl_binary(mni_source *source, mni_intake *intake) {
    uint64_t facets = (source->size - HEAD_BYTES) / FACET_BYTES;
    if (!mni_intake_expect(intake, 0, facets))
        return false;
    mni_source_skip(source, HEAD_BYTES);
    for (uint64_t i = 0; i < facets; i++) {
        if (!mni_source_have(source, FACET_BYTES))
            return mni_source_fail(source, "the file ends in facet %" PRIu64 " of %" PRIu64, i + 1,
                                   facets);
        float place[9];
        double corner[3][3];
        memcpy(place, source->at + NORMAL_BYTES, sizeof place);
        for (int j = 0; j < 9; j++)
            corner[j / 3][j % 3] = (double)place[j];
        if (!mni_intake_soup_triangle(intake, corner))
            return false;
        source->at += FACET_BYTES;
    }
    return true;
}

/* ---- ascii ---------------------------------------------------------------------------------- */

/* The next word, wherever it stands, must be this one. */
static bool expect(mni_source *source, uint64_t facet, const char *keyword) {
    char word[40];
    if (!mni_text_next_anywhere(source, 0))
        return mni_source_fail(source, "the file ends in facet %" PRIu64 ", before '%s'", facet,
                               keyword);
    return mni_text_take(source, keyword) ||
           mni_source_fail(source, "facet %" PRIu64 ": '%s' where '%s' should stand", facet,
                           mni_text_peek(source, word, sizeof word), keyword);
}

/* What follows the word `facet`, whose line holds the normal. */
static bool read_facet(mni_source *source, mni_intake *intake, uint64_t facet) {
    double corner[3][3];
    mni_text_skip_line(source, false);
    if (!expect(source, facet, "outer") || !expect(source, facet, "loop"))
        return false;
    for (int i = 0; i < 3; i++) {
        if (!expect(source, facet, "vertex"))
            return false;
        for (int j = 0; j < 3; j++) {
            mni_text_next(source, false);
            if (!mni_text_double(source, &corner[i][j], "a coordinate"))
                return false;
        }
    }
    return expect(source, facet, "endloop") && expect(source, facet, "endfacet") &&
           mni_intake_soup_triangle(intake, corner);
}

/* solid [name] { facet … } endsolid [name], any number of times. */
bool mni_read_stl_ascii(mni_source *source, mni_intake *intake) {
    uint64_t facets = 0;
    bool open = false;
    char word[40];
    source->text = true;
    while (mni_text_next_anywhere(source, 0)) {
        if (open && mni_text_take(source, "facet")) {
            if (!read_facet(source, intake, ++facets))
                return false;
        } else if (mni_text_take(source, open ? "endsolid" : "solid")) {
            open = !open;
            mni_text_skip_line(source, false);
        } else {
            return mni_source_fail(source, "'%s' where %s should stand",
                                   mni_text_peek(source, word, sizeof word),
                                   open ? "'facet' or 'endsolid'" : "'solid'");
        }
    }
    return !open ||
           mni_source_fail(source, "the file ends after %" PRIu64 " facets, before 'endsolid'",
                           facets);
}
