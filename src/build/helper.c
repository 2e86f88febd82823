/* See helper.h. */
#define _GNU_SOURCE
#include "helper.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "mn_assert.h"
#include "watch.h"

enum { ASKED_APART_MS = 50 };

extern char **environ;

const mni_helper_program mni_helper_openmesh = {"metanode-openmesh", "OpenMesh", "libopenmesh-dev"};
const mni_helper_program mni_helper_netcdf = {"metanode-netcdf", "netCDF", "libnetcdf-dev"};

static bool helper_path(const char *dir, const char *program, char path[PATH_MAX]) {
    char self[PATH_MAX];
    if (dir == NULL)
        dir = getenv("METANODE_HELPER_DIR"); /* where the program's own module is looked for, too */
    if (dir == NULL) {
        ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
        if (length <= 0)
            return false;
        self[length] = 0;
        *strrchr(self, '/') = 0;
        dir = self;
    }
    return snprintf(path, PATH_MAX, "%s/%s", dir, program) < PATH_MAX;
}

/* Standard input, output and error of the child are given; everything else closes on exec. */
static int spawn(pid_t *pid, const char *path, const char *program, const char *const *args,
                 const int fds[3]) {
    char *argv[MNI_HELPER_ARGS_MAX + 2] = {(char *)(uintptr_t)program};
    for (int i = 0; args[i] != NULL; i++) {
        MN_ASSERT(i < MNI_HELPER_ARGS_MAX);
        argv[i + 1] = (char *)(uintptr_t)args[i];
    }
    posix_spawn_file_actions_t actions;
    int error = posix_spawn_file_actions_init(&actions);
    if (error != 0)
        return error;
    for (int i = 0; i < 3 && error == 0; i++)
        error = posix_spawn_file_actions_adddup2(&actions, fds[i], i);
    if (error == 0)
        error = posix_spawn(pid, path, &actions, NULL, argv, environ);
    posix_spawn_file_actions_destroy(&actions);
    return error;
}

mn_code mni_helper_open(mni_helper *helper, const char *helper_dir,
                        const mni_helper_program *program, const char *const *args, mn_status *st) {
    char path[PATH_MAX];
    int in[2] = {-1, -1}, out[2] = {-1, -1};
    mn_code code = MN_OK;
    *helper = (mni_helper){.program = program, .pid = -1, .to = -1, .from = -1, .errors = -1};
    if (!helper_path(helper_dir, program->name, path))
        return mn_fail(st, MN_FAILED, "cannot tell where %s lies", program->name);
    if (access(path, X_OK) != 0)
        return mn_fail(st, MN_FAILED,
                       "%s is not there (%s): it belongs beside metanode or in "
                       "METANODE_HELPER_DIR; where it was not built, install %s and build anew",
                       path, strerror(errno), program->package);
    helper->errors = memfd_create(program->name, MFD_CLOEXEC);
    if (helper->errors < 0 || pipe2(out, O_CLOEXEC) != 0 ||
        socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, in) != 0) {
        code = mn_fail(st, MN_FAILED, "cannot start %s: %s", program->name, strerror(errno));
    } else {
        int error = spawn(&helper->pid, path, program->name, args,
                          (const int[3]){in[1], out[1], helper->errors});
        if (error != 0)
            code = mn_fail(st, MN_FAILED, "cannot start %s: %s", path, strerror(error));
    }
    const int unused[4] = {in[1], out[1], code != MN_OK ? in[0] : -1, code != MN_OK ? out[0] : -1};
    for (int i = 0; i < 4; i++)
        if (unused[i] >= 0)
            close(unused[i]);
    if (code != MN_OK) {
        if (helper->errors >= 0)
            close(helper->errors);
        return code;
    }
    helper->to = in[0];
    helper->from = out[0];
    return MN_OK;
}

bool mni_helper_write(mni_helper *helper, const void *bytes, size_t count) {
    const char *at = bytes;
    while (count > 0 && !helper->cut) {
        ssize_t done = send(helper->to, at, count, MSG_NOSIGNAL);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0) {
            helper->cut = true;
        } else {
            at += done;
            count -= (size_t)done;
        }
    }
    return !helper->cut;
}

void mni_helper_write_end(mni_helper *helper) {
    if (helper->to >= 0)
        close(helper->to);
    helper->to = -1;
}

/* Until there is something to read, or its end. A helper may think for minutes before it answers:
 * who watches is asked meanwhile. */
static void await_answer(mni_helper *helper) {
    mn_status ignored = {0};
    struct pollfd from = {.fd = helper->from, .events = POLLIN};
    int ready;
    do {
        if (mni_watch(&helper->watch, helper->program->library, helper->bytes, 0, &ignored) !=
            MN_OK) {
            helper->cut = helper->given_up = true;
            kill(helper->pid, SIGKILL); /* it is not waited for yet, so the number is its own */
            return;
        }
        ready = poll(&from, 1, ASKED_APART_MS);
    } while (ready == 0 || (ready < 0 && errno == EINTR));
}

bool mni_helper_read(mni_helper *helper, void *bytes, size_t count) {
    char *at = bytes;
    mni_helper_write_end(helper);
    while (count > 0 && !helper->cut) {
        await_answer(helper);
        if (helper->cut)
            break;
        ssize_t done = read(helper->from, at, count);
        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0) {
            helper->cut = true;
        } else {
            at += done;
            count -= (size_t)done;
            helper->bytes += (uint64_t)done;
        }
    }
    return !helper->cut;
}

bool mni_helper_read_head(mni_helper *helper, mni_helper_head *head) {
    if (!mni_helper_read(helper, head, sizeof *head))
        return false;
    if (memcmp(head->magic, "MNOMSTRM", sizeof head->magic) != 0)
        helper->cut = true;
    return !helper->cut;
}

static void first_line(int file, char line[MNI_HELPER_LINE_BYTES]) {
    ssize_t length = pread(file, line, MNI_HELPER_LINE_BYTES - 1, 0);
    line[length > 0 ? length : 0] = 0;
    line[strcspn(line, "\n")] = 0;
}

mn_code mni_helper_close(mni_helper *helper, const char *about, char line[MNI_HELPER_LINE_BYTES],
                         mn_status *st) {
    char own_line[MNI_HELPER_LINE_BYTES];
    int status = 0;
    mni_helper_write_end(helper);
    close(helper->from); /* one that still writes gets SIGPIPE and ends */
    while (waitpid(helper->pid, &status, 0) < 0)
        MN_ASSERT(errno == EINTR);
    first_line(helper->errors, own_line);
    close(helper->errors);
    const char *library = helper->program->library;
    const bool given_up = helper->given_up;
    *helper = (mni_helper){.pid = -1, .to = -1, .from = -1, .errors = -1, .cut = helper->cut};
    if (line != NULL)
        memcpy(line, own_line, sizeof own_line);
    if (given_up)
        return mn_fail(st, MN_FAILED, "%s: interrupted", about);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return !helper->cut ? MN_OK
                            : mn_fail(st, MN_FAILED, "%s: the helper's answer is cut short", about);
    if (WIFEXITED(status))
        return mn_fail(st, WEXITSTATUS(status) == MN_BAD_INPUT ? MN_BAD_INPUT : MN_FAILED, "%s: %s",
                       about, own_line[0] != 0 ? own_line : "the helper failed");
    if (WTERMSIG(status) == SIGXCPU)
        return mn_fail(st, MN_BAD_INPUT, "%s: %s does not come to an end with it", about, library);
    if (WTERMSIG(status) == SIGPIPE)
        return mn_fail(st, MN_FAILED, "%s: reading it was given up", about);
    if (WTERMSIG(status) == SIGINT || WTERMSIG(status) == SIGTERM || WTERMSIG(status) == SIGHUP)
        return mn_fail(st, MN_FAILED, "%s: %s was interrupted (%s)", about, library,
                       strsignal(WTERMSIG(status)));
    return mn_fail(st, MN_BAD_INPUT, "%s: %s crashes on it (%s)", about, library,
                   strsignal(WTERMSIG(status)));
}
