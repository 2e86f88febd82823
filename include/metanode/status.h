/* What every call of the library says of its outcome.
 *
 * Three kinds of trouble, never mixed: a bug is an assertion; the environment (a file, the kernel,
 * bad data) is an mn_status; scarcity (no place holder, a full board) is normal: a bool and a
 * counter. Any thread; nothing here blocks or allocates. */
#ifndef METANODE_STATUS_H
#define METANODE_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

/* The values are the program's exit codes. */
typedef enum mn_code {
    MN_OK = 0,
    MN_FAILED = 1,        /* the machine failed us: read or write error, no memory, a lost helper */
    MN_USAGE = 2,         /* options that contradict each other or are out of range */
    MN_BAD_INPUT = 3,     /* a file that cannot be trusted */
    MN_NO_SPACE = 4,      /* disk full */
    MN_CAP_TOO_SMALL = 5, /* the text names the smallest cap that would work */
    MN_NO_GRAPHICS = 6,   /* no EGL, no display, no driver */
} mn_code;

/* What a write is called that failed with this errno: MN_NO_SPACE for a full disk, a quota or a
 * limit on files (ulimit -f; who wants that told instead of dying of SIGXFSZ ignores the signal),
 * else MN_FAILED. */
mn_code mn_code_of_write(int error);

/* One line: what, where, what to do. Owned by the caller; text is valid only when code != MN_OK. */
typedef struct mn_status {
    mn_code code;
    char text[600];
} mn_status;

/* Fills *st (which may be NULL) and returns code, so that `return mn_fail(st, …)` reads well.
 * The first failure wins: an mn_status that already holds one is left alone. */
mn_code mn_fail(mn_status *st, mn_code code, const char *format, ...)
#if defined(__GNUC__)
    __attribute__((format(printf, 3, 4)))
#endif
    ;

#ifdef __cplusplus
}
#endif
#endif
