/* What the cutting of a tree into blocks takes of memory (need_block.c). Pure; any thread. */
#ifndef MNI_NEED_BLOCK_H
#define MNI_NEED_BLOCK_H

#include "metanode/build.h"

/* Beside the program and pages of the tree. threaded: with a thread beside the packer. */
uint64_t mni_block_work(const mn_block_desc *desc, uint64_t leaves, bool threaded);
/* Is there room for that thread, beside so much that the caller has? */
bool mni_block_threaded(const mn_block_desc *desc, uint64_t leaves, uint64_t held_bytes);
/* A tree in memory with its rows. */
uint64_t mni_tree_rows_bytes(uint64_t leaves, uint64_t simplices, bool has_colors);

#endif
