/* See reference.h. Hides the other process and what the two say to each other over a socket:
 *
 *     replay                          the reference
 *                      <── answer     the file is read, the driver loaded; or why not
 *     frame, picture   ──>            navigates up to the frame, draws it, compares
 *                      <── answer     likeness
 *     closes           ──>            ends
 *
 * The reference has the options of the run but for what makes it poor: no cap, no place holders,
 * the `resident` store. It ends with the socket, however replay ends. */
#include "reference.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "picture.h"

enum { OPENING_FRAMES_MAX = 1 << 12 };

typedef struct answer {
    mn_status status;
    mn_likeness likeness;
} answer;

/* ---- the socket ------------------------------------------------------------------------------ */

static bool send_all(int socket, const void *data, size_t bytes) {
    for (const char *at = data; bytes > 0;) {
        const ssize_t n = send(socket, at, bytes, MSG_NOSIGNAL);
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return false;
        at += n;
        bytes -= (size_t)n;
    }
    return true;
}

static bool receive_all(int socket, void *data, size_t bytes) {
    for (char *at = data; bytes > 0;) {
        const ssize_t n = recv(socket, at, bytes, 0);
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return false;
        at += n;
        bytes -= (size_t)n;
    }
    return true;
}

/* ---- the other process ----------------------------------------------------------------------- */

typedef struct other {
    const mn_path *path;
    uint32_t frames, next; /* the frame to be navigated next */
    mn_session *session;
    picture picture;
    uint8_t *theirs; /* the picture to compare with */
} other;

static mn_code open_other(other *o, const mn_session_desc *desc, bool from_settled, mn_status *st) {
    mn_code code = mn_session_open(desc, &o->session, st);
    if (code == MN_OK)
        code = picture_open(&o->picture, o->session, desc->width_px, desc->height_px, true, st);
    o->theirs = malloc(3 * (size_t)desc->width_px * desc->height_px);
    if (code == MN_OK && o->theirs == NULL)
        code = mn_fail(st, MN_FAILED, "--reference: no memory for a picture");
    mn_camera camera;
    mn_path_camera(o->path, 0, o->frames, &camera);
    for (int i = 0; code == MN_OK && from_settled && i < OPENING_FRAMES_MAX; i++)
        if (!mn_session_opening(o->session, &camera, NULL))
            break;
    return code;
}

static mn_code compare(other *o, uint32_t frame, mn_likeness *out, mn_status *st) {
    static const mn_gl_look look = {0};
    mn_camera camera;
    uint32_t width, height;
    const uint8_t *ours;
    do {
        mn_path_camera(o->path, o->next, o->frames, &camera);
        mn_session_frame(o->session, &camera, NULL);
    } while (o->next++ < frame);
    mn_code code = picture_draw(&o->picture, o->session, &camera, &look, st);
    if (code == MN_OK)
        code = picture_rgb(&o->picture, &ours, &width, &height, st);
    return code == MN_OK ? o->picture.load.api->likeness(o->theirs, ours, width, height, out, st)
                         : code;
}

static void serve(int socket, other *o, const mn_session_desc *desc, bool from_settled) {
    const size_t bytes = 3 * (size_t)desc->width_px * desc->height_px;
    uint32_t frame;
    answer a = {0};
    open_other(o, desc, from_settled, &a.status);
    while (send_all(socket, &a, sizeof a) && a.status.code == MN_OK &&
           receive_all(socket, &frame, sizeof frame) && receive_all(socket, o->theirs, bytes))
        compare(o, frame, &a.likeness, &a.status);
}

/* ---- replay's side --------------------------------------------------------------------------- */

static mn_code listen_to(const reference *r, mn_likeness *out, mn_status *st) {
    answer a;
    if (!receive_all(r->socket, &a, sizeof a))
        return mn_fail(st, MN_FAILED,
                       "--reference: the process that draws it has gone; has it memory for the "
                       "whole file?");
    if (a.status.code != MN_OK)
        return mn_fail(st, a.status.code, "--reference: %s", a.status.text);
    *out = a.likeness;
    return MN_OK;
}

mn_code reference_open(reference *r, const mn_session_desc *desc, const mn_path *path,
                       uint32_t frames, bool from_settled, mn_status *st) {
    int ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
        return mn_fail(st, MN_FAILED, "--reference: no socket: %s", strerror(errno));
    const pid_t child = fork();
    if (child < 0) {
        close(ends[0]);
        close(ends[1]);
        return mn_fail(st, MN_FAILED, "--reference: no second process: %s", strerror(errno));
    }
    if (child == 0) {
        close(ends[0]);
        other o = {.path = path, .frames = frames};
        mn_session_desc resident = *desc;
        resident.store = MN_STORE_RESIDENT;
        resident.ram_bytes = resident.base_bytes = 0;
        resident.k = MN_K_FROM_RAM;
        resident.trace_path = NULL;
        resident.warn = NULL;
        serve(ends[1], &o, &resident, from_settled);
        _exit(0); /* nothing of replay's is flushed, closed or written twice */
    }
    close(ends[1]);
    *r = (reference){.child = child,
                     .socket = ends[0],
                     .picture_bytes = 3 * (size_t)desc->width_px * desc->height_px};
    mn_likeness none;
    return listen_to(r, &none, st);
}

mn_code reference_compare(reference *r, uint32_t frame, const uint8_t *rgb, mn_likeness *out,
                          mn_status *st) {
    send_all(r->socket, &frame, sizeof frame); /* if it has gone, no answer will come */
    send_all(r->socket, rgb, r->picture_bytes);
    return listen_to(r, out, st);
}

void reference_close(reference *r) {
    if (r->child <= 0)
        return;
    close(r->socket);
    while (waitpid(r->child, NULL, 0) < 0 && errno == EINTR)
        continue;
    *r = (reference){0};
}
