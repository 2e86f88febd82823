/* Throws that a seed repeats, for the suites that play a structure against a list of what it should
 * hold. Whoever includes it sets random_state, and prints the seed. */
#ifndef TESTS_RUNTIME_DICE_H
#define TESTS_RUNTIME_DICE_H

#include <stdint.h>

static uint64_t random_state;

static uint32_t uniform(uint32_t below) {
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)((random_state >> 33) % below);
}

#endif
