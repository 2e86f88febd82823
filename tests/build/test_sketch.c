/* Goal: the bound of a sketch is above the true number, and not far.
 * Method: numbers of hashed integers from none to a million, each several times over. */
#include "read_help.h"
#include "sketch.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

START_TEST(bounds) {
    static const uint64_t numbers[] = {0, 1, 10, 1000, 20000, 41000, 45000, 100000, 1000000};
    mni_sketch *sketch = malloc(sizeof *sketch);
    ck_assert_ptr_nonnull(sketch);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        memset(sketch, 0, sizeof *sketch);
        for (uint64_t k = 0; k < 3 * numbers[i]; k++) {
            uint64_t number = k % numbers[i];
            mni_sketch_add(sketch, XXH3_64bits(&number, sizeof number));
        }
        uint64_t bound = mni_sketch_bound(sketch);
        ck_assert_uint_ge(bound, numbers[i]);
        ck_assert_uint_le(bound, numbers[i] + numbers[i] / 10 + 2);
    }
    free(sketch);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("sketch");
    TCase *tests = tcase_create("sketch");
    tcase_add_test(tests, bounds);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
