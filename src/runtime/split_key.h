/* A split's turn as one number: smaller keys come first.
 *
 * By error alone, or by half doublings of the error over the tolerance and, within one of them, by
 * place. A key is below MNI_SPLIT_KEYS: the bit above is for who is put off (refusals.h). Pure
 * functions; any thread. */
#ifndef MNI_SPLIT_KEY_H
#define MNI_SPLIT_KEY_H

#include <stdint.h>

#define MNI_SPLIT_KEYS 0x80000000u
enum { MNI_SPLIT_PLACES = 1 << 26 }; /* a place is below */

uint32_t mni_split_key(double priority_px);
uint32_t mni_split_key_by_place(double priority_px, double tolerance_px, uint32_t place);
/* The error of a key, or somewhat above: no error that is larger has a later key. */
double mni_split_key_px(uint32_t key);
double mni_split_key_by_place_px(uint32_t key, double tolerance_px);

#endif
