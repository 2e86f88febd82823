/* How every suite ends: runs it, and says with what the process exits. */
#ifndef TESTS_SUITE_H
#define TESTS_SUITE_H

#include <check.h>

/* Frees the suite. CK_VERBOSITY and CK_RUN_CASE in the environment are heeded. forks: CK_NOFORK
 * where tests must run in this process. */
static inline int suite_run_as(Suite *suite, enum fork_status forks) {
    SRunner *runner = srunner_create(suite);
    srunner_set_fork_status(runner, forks);
    srunner_run_all(runner, CK_ENV);
    const int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed == 0 ? 0 : 1;
}
static inline int suite_run(Suite *suite) {
    return suite_run_as(suite, CK_FORK_GETENV);
}

#endif
