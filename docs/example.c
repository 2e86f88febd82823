/* Flies once round a .mnt under a cap of 16 MB for the whole process, and says what each frame has.
 *     cc example.c $(pkg-config --cflags --libs metanode) -o example && ./example planet.mnt
 * C, and C++ as well. */
#include <inttypes.h>
#include <stdio.h>

#include <metanode/runtime.h>

int main(int argc, char **argv) {
    enum { FRAMES = 60 };
    static mn_session_desc desc; /* what is 0 is the default */
    mn_session *session = NULL;
    mn_path *path = NULL;
    mn_status st = {MN_OK, ""};
    desc.path = argc > 1 ? argv[1] : "planet.mnt";
    desc.ram_bytes = 16 << 20;
    if (mn_session_open(&desc, &session, &st) == MN_OK &&
        mn_path_open("orbit", mn_session_header(session), 45, &path, &st) == MN_OK)
        for (uint32_t frame = 0; frame < FRAMES; frame++) {
            mn_camera camera;
            mn_frame_stats stats;
            mn_front front;
            mn_path_camera(path, frame, FRAMES, &camera);
            mn_session_frame(session, &camera, &stats); /* never waits for the disk */
            mn_session_front(session, &front);          /* what there is to draw */
            printf("frame %" PRIu32 ": %" PRIu64 " triangles, %.2f px, %" PRIu64 " misses\n", frame,
                   front.triangles, stats.error_px, stats.misses);
        }
    if (st.code != MN_OK) /* one line: what, where, what to do */
        fprintf(stderr, "%s\n", st.text);
    mn_path_close(path);
    mn_session_close(session);
    return st.code;
}
