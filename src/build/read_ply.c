/* PLY: ascii and both binary byte orders, any elements in any order.
 *
 * Secret: the header's grammar and the scalar types. Of the elements, `vertex` gives x, y, z and
 * perhaps red, green, blue, alpha; `face` gives polygons and `tristrips` strips (-1 starts a new
 * one), each in a list vertex_index or vertex_indices. Everything else is passed over. Counts are
 * held against the size of the file before anything is made of them. In ascii an item is a line.
 * Order: one call. Memory: the header's tables, 16 kB. */
#include "reader.h"

#include <inttypes.h>
#include <string.h>

#include "mn_assert.h"

enum { NAME_MAX_BYTES = 40, ELEMENTS_MAX = 32, PROPERTIES_MAX = 512 };

typedef enum scalar { I8, U8, I16, U16, I32, U32, F32, F64, NO_SCALAR } scalar;
static const uint8_t scalar_bytes[] = {1, 1, 2, 2, 4, 4, 4, 8, 0};
static const double color_max[] = {127, 255, 32767, 65535, 2147483647, 4294967295.0, 1, 1, 0};

typedef enum encoding { ASCII, LITTLE, BIG } encoding;
typedef enum kind { OTHER, VERTEX, FACE, TRISTRIPS } kind;
typedef enum role { X, Y, Z, RED, GREEN, BLUE, ALPHA, ROLES, INDICES = ROLES, NONE } role;

typedef struct property {
    scalar type;
    scalar count_type; /* NO_SCALAR: no list */
    role role;
    char name[NAME_MAX_BYTES];
} property;

typedef struct element {
    kind kind;
    uint64_t count;
    uint32_t first, properties; /* in ply.property */
    bool lists;
    uint32_t bytes; /* of one in binary, its lists being empty */
    bool has[NONE + 1];
    char name[NAME_MAX_BYTES];
} element;

typedef struct ply {
    mni_source *source;
    mni_intake *intake;
    encoding encoding;
    uint64_t vertices; /* as the header says */
    uint32_t elements, properties;
    element element[ELEMENTS_MAX];
    property property[PROPERTIES_MAX];
} ply;

/* ---- header --------------------------------------------------------------------------------- */

static scalar scalar_named(const char *name) {
    static const char *const names[][2] = {
        {"char", "int8"}, {"uchar", "uint8"}, {"short", "int16"},   {"ushort", "uint16"},
        {"int", "int32"}, {"uint", "uint32"}, {"float", "float32"}, {"double", "float64"}};
    for (int i = 0; i < NO_SCALAR; i++)
        if (strcmp(name, names[i][0]) == 0 || strcmp(name, names[i][1]) == 0)
            return (scalar)i;
    return NO_SCALAR;
}

static kind kind_named(const char *name) {
    return strcmp(name, "vertex") == 0      ? VERTEX
           : strcmp(name, "face") == 0      ? FACE
           : strcmp(name, "tristrips") == 0 ? TRISTRIPS
                                            : OTHER;
}

static role role_named(kind of, bool list, const char *name) {
    static const char *const vertex_roles[] = {"x", "y", "z", "red", "green", "blue", "alpha"};
    if (of == FACE || of == TRISTRIPS)
        return list && (strcmp(name, "vertex_index") == 0 || strcmp(name, "vertex_indices") == 0)
                   ? INDICES
                   : NONE;
    for (int i = 0; of == VERTEX && i < ROLES; i++)
        if (strcmp(name, vertex_roles[i]) == 0)
            return (role)i;
    return NONE;
}

/* The next word of a header line; false (and said) when there is none. */
static bool header_word(ply *p, char word[NAME_MAX_BYTES], const char *what) {
    if (!mni_text_next(p->source, false))
        return mni_source_fail(p->source, "the line ends where %s should stand", what);
    mni_text_word(p->source, word, NAME_MAX_BYTES);
    return true;
}

static bool header_scalar(ply *p, const char *word, scalar *type) {
    *type = scalar_named(word);
    return *type != NO_SCALAR || mni_source_fail(p->source, "'%s' is no type of PLY", word);
}

static bool header_format(ply *p) {
    char word[NAME_MAX_BYTES];
    if (!header_word(p, word, "a format"))
        return false;
    if (strcmp(word, "ascii") == 0)
        p->encoding = ASCII;
    else if (strcmp(word, "binary_little_endian") == 0)
        p->encoding = LITTLE;
    else if (strcmp(word, "binary_big_endian") == 0)
        p->encoding = BIG;
    else
        return mni_source_fail(p->source, "'%s' is no format of PLY", word);
    if (!header_word(p, word, "the format's version"))
        return false;
    return strcmp(word, "1.0") == 0 ||
           mni_source_fail(p->source, "version %s of PLY is not known: 1.0 is", word);
}

static bool header_element(ply *p) {
    if (p->elements == ELEMENTS_MAX)
        return mni_source_fail(p->source, "more than %d elements", ELEMENTS_MAX);
    element *e = &p->element[p->elements];
    int64_t count;
    *e = (element){.first = p->properties};
    if (!header_word(p, e->name, "an element's name"))
        return false;
    mni_text_next(p->source, false);
    if (!mni_text_integer(p->source, &count, "the element's count"))
        return false;
    if (count < 0)
        return mni_source_fail(p->source, "element %s has a count of %" PRId64, e->name, count);
    e->kind = kind_named(e->name);
    e->count = (uint64_t)count;
    for (uint32_t i = 0; i < p->elements; i++)
        if (e->kind != OTHER && p->element[i].kind == e->kind)
            return mni_source_fail(p->source, "element %s comes twice", e->name);
    if (e->kind == VERTEX)
        p->vertices = e->count;
    p->elements++;
    return true;
}

static bool header_property(ply *p) {
    char word[NAME_MAX_BYTES];
    if (p->elements == 0)
        return mni_source_fail(p->source, "a property before any element");
    if (p->properties == PROPERTIES_MAX)
        return mni_source_fail(p->source, "more than %d properties", PROPERTIES_MAX);
    element *e = &p->element[p->elements - 1];
    property *q = &p->property[p->properties];
    *q = (property){.count_type = NO_SCALAR};
    if (!header_word(p, word, "a type"))
        return false;
    bool list = strcmp(word, "list") == 0;
    if (list && (!header_word(p, word, "a type") || !header_scalar(p, word, &q->count_type) ||
                 !header_word(p, word, "a type")))
        return false;
    if (!header_scalar(p, word, &q->type) || !header_word(p, q->name, "the property's name"))
        return false;
    if (q->count_type == F32 || q->count_type == F64)
        return mni_source_fail(p->source, "list %s is counted by a float", q->name);
    q->role = role_named(e->kind, list, q->name);
    if (q->role < INDICES && list)
        return mni_source_fail(p->source, "%s is a list: a number is wanted", q->name);
    if (q->role == INDICES && (q->type == F32 || q->type == F64))
        return mni_source_fail(p->source, "%s are floats: integers are wanted", q->name);
    if (q->role != NONE && e->has[q->role])
        return mni_source_fail(p->source, "element %s has two properties %s", e->name, q->name);
    e->has[q->role] = q->role != NONE;
    e->lists = e->lists || list;
    e->bytes += scalar_bytes[list ? q->count_type : q->type];
    e->properties++;
    p->properties++;
    return true;
}

/* Takes the header up to the first byte of the data. */
static bool read_header(ply *p) {
    bool format_seen = false;
    p->source->text = true;
    while (mni_text_skip_line(p->source, false)) {
        char word[NAME_MAX_BYTES];
        if (!mni_text_next(p->source, false))
            continue;
        mni_text_word(p->source, word, sizeof word);
        bool ok = true;
        if (strcmp(word, "end_header") == 0)
            return (format_seen || mni_source_fail(p->source, "the header names no format")) &&
                   (mni_text_skip_line(p->source, false) || p->encoding == ASCII ||
                    mni_source_fail(p->source, "the file ends with its header"));
        if (strcmp(word, "format") == 0)
            ok = format_seen = header_format(p);
        else if (strcmp(word, "element") == 0)
            ok = header_element(p);
        else if (strcmp(word, "property") == 0)
            ok = header_property(p);
        else if (strcmp(word, "comment") != 0 && strcmp(word, "obj_info") != 0)
            ok = mni_source_fail(p->source, "'%s' is no word of a PLY header", word);
        if (!ok)
            return false;
    }
    return mni_source_fail(p->source, "the file ends before end_header");
}

static bool check_elements(ply *p) {
    bool vertices = false, faces = false;
    for (uint32_t i = 0; i < p->elements; i++) {
        const element *e = &p->element[i];
        if (e->kind == VERTEX && !(e->has[X] && e->has[Y] && e->has[Z]))
            return mni_source_fail(p->source, "element vertex has no property %s",
                                   e->has[X] ? e->has[Y] ? "z" : "y" : "x");
        if ((e->kind == FACE || e->kind == TRISTRIPS) && !e->has[INDICES])
            return mni_source_fail(p->source, "element %s has no list vertex_indices", e->name);
        vertices = vertices || e->kind == VERTEX;
        faces = faces || e->kind == FACE || e->kind == TRISTRIPS;
    }
    if (!vertices)
        return mni_source_fail(p->source, "the header has no element vertex");
    return faces || mni_source_fail(p->source, "the header has no element face: points alone are "
                                               "no mesh");
}

/* No element can have more items than the rest of the file has room for. */
static bool check_counts(ply *p) {
    uint64_t left = mni_source_left(p->source), promised = 0;
    for (uint32_t i = 0; i < p->elements; i++) {
        const element *e = &p->element[i];
        /* ascii: a digit and a blank or line end each; the last line end may be missing */
        uint64_t bytes = p->encoding == ASCII ? 2 * (uint64_t)e->properties : e->bytes;
        uint64_t all;
        if (__builtin_mul_overflow(e->count, bytes, &all) ||
            __builtin_add_overflow(promised, all, &promised) || promised > left + 1 ||
            (p->encoding != ASCII && promised > left))
            return mni_source_fail(
                p->source,
                "%" PRIu64 " of element %s cannot be: %" PRIu64
                " bytes are left in the file; it is cut off, or its header wrong",
                e->count, e->name, left);
    }
    return true;
}

/* ---- data ----------------------------------------------------------------------------------- */

static bool cut(ply *p, const element *e, uint64_t number) {
    return mni_source_fail(p->source,
                           "the file ends in %s %" PRIu64 " of %" PRIu64 ": it is cut off", e->name,
                           number, e->count);
}

static uint64_t load(const char *from, uint32_t bytes, encoding order) {
    uint16_t two;
    uint32_t four;
    uint64_t eight;
    switch (bytes) {
    case 1:
        return (uint8_t)*from;
    case 2:
        memcpy(&two, from, sizeof two);
        return order == BIG ? __builtin_bswap16(two) : two;
    case 4:
        memcpy(&four, from, sizeof four);
        return order == BIG ? __builtin_bswap32(four) : four;
    default:
        memcpy(&eight, from, sizeof eight);
        return order == BIG ? __builtin_bswap64(eight) : eight;
    }
}

static int64_t decode_integer(const char *from, scalar type, encoding order) {
    uint64_t bits = load(from, scalar_bytes[type], order);
    switch (type) {
    case I8:
        return (int8_t)bits;
    case I16:
        return (int16_t)bits;
    case I32:
        return (int32_t)bits;
    default:
        return (int64_t)bits;
    }
}

static double decode(const char *from, scalar type, encoding order) {
    if (type != F32 && type != F64)
        return (double)decode_integer(from, type, order);
    uint64_t bits = load(from, scalar_bytes[type], order);
    uint32_t low = (uint32_t)bits;
    float single;
    double full;
    memcpy(&single, &low, sizeof single);
    memcpy(&full, &bits, sizeof full);
    return type == F32 ? (double)single : full;
}

/* One number, wherever it stands. */
static bool read_scalar(ply *p, const element *e, const property *q, uint64_t number, scalar type,
                        double *value) {
    if (p->encoding == ASCII) {
        mni_text_next(p->source, false);
        return mni_text_double(p->source, value, q->name);
    }
    if (!mni_source_have(p->source, scalar_bytes[type]))
        return cut(p, e, number);
    *value = decode(p->source->at, type, p->encoding);
    p->source->at += scalar_bytes[type];
    return true;
}

static bool read_integer(ply *p, const element *e, const property *q, uint64_t number, scalar type,
                         int64_t *value) {
    if (p->encoding == ASCII) {
        mni_text_next(p->source, false);
        return mni_text_integer(p->source, value, q->name);
    }
    if (!mni_source_have(p->source, scalar_bytes[type]))
        return cut(p, e, number);
    *value = decode_integer(p->source->at, type, p->encoding);
    p->source->at += scalar_bytes[type];
    return true;
}

static bool read_corners(ply *p, const element *e, const property *q, uint64_t number,
                         uint64_t count) {
    mni_polygon polygon = {0};
    mni_strip strip = {0};
    for (uint64_t i = 0; i < count; i++) {
        int64_t vertex;
        if (!read_integer(p, e, q, number, q->type, &vertex))
            return false;
        if (e->kind == TRISTRIPS && vertex == -1) {
            mni_strip_restart(&strip);
            continue;
        }
        if (vertex < 0 || (uint64_t)vertex >= p->vertices)
            return mni_read_out_of_range(p->source, e->kind == FACE ? "face" : "strip", number,
                                         vertex, p->vertices);
        if (e->kind == FACE ? !mni_polygon_corner(&polygon, p->intake, (uint32_t)vertex)
                            : !mni_strip_corner(&strip, p->intake, (uint32_t)vertex))
            return false;
    }
    return e->kind == TRISTRIPS || mni_polygon_end(&polygon, p->intake);
}

static bool read_list(ply *p, const element *e, const property *q, uint64_t number) {
    int64_t count;
    if (!read_integer(p, e, q, number, q->count_type, &count))
        return false;
    uint64_t item_bytes = p->encoding == ASCII ? 2 : scalar_bytes[q->type];
    uint64_t left = mni_source_left(p->source);
    if (count < 0 || (uint64_t)count > (left + 1) / item_bytes)
        return mni_source_fail(p->source,
                               "%s %" PRIu64 ": a list of %" PRId64 " cannot be: %" PRIu64
                               " bytes are left in the file; it is cut off, or that count wrong",
                               e->name, number, count, left);
    if (q->role == INDICES)
        return read_corners(p, e, q, number, (uint64_t)count);
    if (p->encoding != ASCII)
        return mni_source_skip(p->source, (uint64_t)count * item_bytes) || cut(p, e, number);
    for (int64_t i = 0; i < count; i++) {
        double passed;
        if (!read_scalar(p, e, q, number, q->type, &passed))
            return false;
    }
    return true;
}

static uint32_t color_of(const ply *p, const element *e, const double value[ROLES]) {
    uint32_t rgba = MNI_WHITE;
    for (uint32_t i = 0; i < e->properties; i++) {
        const property *q = &p->property[e->first + i];
        if (q->role < RED || q->role > ALPHA)
            continue;
        uint32_t shift = 8 * (uint32_t)(q->role - RED);
        uint32_t channel = mni_read_channel(value[q->role] / color_max[q->type]);
        rgba = (rgba & ~(UINT32_C(255) << shift)) | channel << shift;
    }
    return rgba;
}

static bool take_vertex(ply *p, const element *e, const double value[ROLES]) {
    if (!(e->has[RED] && e->has[GREEN] && e->has[BLUE]))
        return mni_intake_vertex(p->intake, value);
    return mni_intake_vertex_color(p->intake, value, color_of(p, e, value));
}

static bool read_item(ply *p, const element *e, uint64_t number) {
    double value[ROLES] = {0};
    if (p->encoding == ASCII && !mni_text_next_anywhere(p->source, 0))
        return cut(p, e, number);
    for (uint32_t i = 0; i < e->properties; i++) {
        const property *q = &p->property[e->first + i];
        double passed;
        bool ok = q->count_type != NO_SCALAR
                      ? read_list(p, e, q, number)
                      : read_scalar(p, e, q, number, q->type,
                                    q->role < ROLES ? &value[q->role] : &passed);
        if (!ok)
            return false;
    }
    if (p->encoding == ASCII) {
        if (mni_text_next(p->source, false))
            return mni_source_fail(p->source, "%s %" PRIu64 " has more values than the header says",
                                   e->name, number);
        mni_text_skip_line(p->source, false);
    }
    return e->kind != VERTEX || take_vertex(p, e, value);
}

static bool read_element(ply *p, const element *e) {
    if (e->properties == 0)
        return true; /* nothing stands in the file */
    if (e->kind == OTHER && !e->lists && p->encoding != ASCII)
        return mni_source_skip(p->source, e->count * e->bytes) || cut(p, e, e->count);
    for (uint64_t i = 0; i < e->count; i++)
        if (!read_item(p, e, i + 1))
            return false;
    return true;
}

/* After the last element the file must end: otherwise its counts are too low. */
static bool check_end(ply *p) {
    bool more =
        p->encoding == ASCII ? mni_text_next_anywhere(p->source, 0) : mni_source_have(p->source, 1);
    return !more || mni_source_fail(p->source, "the file goes on after all that its header counts");
}

bool mni_read_ply(mni_source *source, mni_intake *intake) {
    ply p = {.source = source, .intake = intake};
    if (!read_header(&p) || !check_elements(&p) || !check_counts(&p))
        return false;
    source->text = p.encoding == ASCII;
    uint64_t faces = 0;
    for (uint32_t i = 0; i < p.elements; i++)
        faces += p.element[i].kind == FACE ? p.element[i].count : 0;
    if (!mni_intake_expect(intake, p.vertices, faces))
        return false;
    for (uint32_t i = 0; i < p.elements; i++)
        if (!read_element(&p, &p.element[i]))
            return false;
    return check_end(&p);
}
