/* Small meshes and their trees for the suites of the build; the caller frees with mn_mesh_free and
 * mn_tree_free. Same arguments, same bytes. */
#ifndef TREE_FIXTURE_H
#define TREE_FIXTURE_H

#include "metanode/build.h"

uint64_t fixture_seed(uint64_t usual); /* MN_SEED, or the usual one; printed */
uint32_t fixture_random(uint64_t *state);

/* A hilly sheet of n × n vertices. */
void fixture_sheet(uint32_t n, uint64_t seed, bool colors, mn_mesh *out);
/* One edge with so many triangles: a book. Its kill node overflows. */
void fixture_book(uint32_t pages, mn_mesh *out);
/* mn_simplify, which must succeed. */
void fixture_tree(const mn_mesh *mesh, mn_tree *out);
/* Any input's tree with the collapse order drawn by lot: random binary tree over the vertices, kill
 * nodes by definition. Deep and unbalanced in parts; no hinges. */
void fixture_random_tree(const mn_mesh *mesh, uint64_t seed, mn_tree *out);

/* The tree that a .mnt holds, all of it checked. */
mn_code fixture_load(const char *path, mn_tree *out, mn_status *st);
/* Asserts (Check) that both say the same, triangles up to their first corner. */
void fixture_same(const mn_tree *a, const mn_tree *b);
/* A name in the test's own temporary folder, made at first use; static storage. */
const char *fixture_path(const char *name);

#endif
