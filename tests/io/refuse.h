/* A kernel that refuses: seccomp filters for tests, as containers have them. For the calling
 * process and its threads, and for good: Check runs each test in a process of its own. */
#ifndef TESTS_IO_REFUSE_H
#define TESTS_IO_REFUSE_H

#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/prctl.h>

/* From now on a system call fails with `error` whenever argument `arg` (its lower half) has bits of
 * `mask` that are `value`; mask 0: always. false: there are no filters here. */
static inline bool refuse_call(unsigned number, unsigned arg, unsigned mask, unsigned value,
                               unsigned error) {
    const unsigned at = (unsigned)offsetof(struct seccomp_data, args) + 8 * arg;
    struct sock_filter program[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, number, 0, 4),
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, at),
        BPF_STMT(BPF_ALU | BPF_AND | BPF_K, mask),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | error),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    struct sock_fprog filter = {.len = sizeof program / sizeof program[0], .filter = program};
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
           prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) == 0;
}

#endif
