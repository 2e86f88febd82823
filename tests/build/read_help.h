/* For the tests of the readers: bytes become a file, the file a mesh. */
#ifndef READ_HELP_H
#define READ_HELP_H

#include <check.h>
#include <stddef.h>

#include "metanode/build.h"
#include "suite.h"

/* Reads bytes as a mesh file. desc NULL: defaults. */
mn_code read_bytes(const void *bytes, size_t size, const mn_read_desc *desc, mn_mesh *out,
                   mn_status *st);
/* The same of a text, which must be readable. */
mn_mesh read_text(const char *text, const mn_read_desc *desc);
/* Reads a text that must be refused as MN_BAD_INPUT, in one line with that phrase in it. */
void expect_refusal(const void *bytes, size_t size, const char *phrase);
/* Are corners of triangle t at these places (in this order, up to rotation)? */
bool has_triangle(const mn_mesh *mesh, uint32_t t, const double place[3][3]);
/* The path of a real mesh, or NULL (and a word about it) when it is not there. */
const char *real_mesh(const char *name);
/* Everything that a mesh must be, whatever it was read from. */
void check_mesh(const mn_mesh *mesh);

#endif
