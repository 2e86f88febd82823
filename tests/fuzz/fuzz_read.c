/* Goal: no bytes make a reader read or write out of bounds, hang, or hand on a broken mesh.
 * Method: libFuzzer, with the readers instrumented. The first byte picks the options, so that one
 * corpus serves them all.
 *
 *   CC=clang CXX=clang++ meson setup build-fuzz -Dfuzz=true -Db_sanitize=address,undefined \
 *       -Db_lundef=false -Dc_args=-fsanitize=fuzzer-no-link
 *   ninja -C build-fuzz tests/fuzz/fuzz_read && build-fuzz/tests/fuzz/fuzz_read CORPUS */
#define _GNU_SOURCE 1

#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "mn_assert.h"
#include "metanode/build.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check_mesh(const mn_mesh *mesh) {
    const mn_intake *c = &mesh->intake;
    MN_ASSERT(mesh->triangles > 0 && mesh->vertices > 2);
    MN_ASSERT(c->input_faces ==
              mesh->triangles + c->duplicate_faces + c->degenerate_faces + c->nonfinite_faces);
    for (uint64_t i = 0; i < 3 * (uint64_t)mesh->triangles; i++)
        MN_ASSERT(mesh->corner[i] < mesh->vertices);
    for (uint64_t i = 0; i < 3 * (uint64_t)mesh->vertices; i++)
        MN_ASSERT(__builtin_isfinite(mesh->position[i]));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size == 0)
        return 0;
    int fd = memfd_create("fuzz", MFD_CLOEXEC);
    MN_ASSERT(fd >= 0 && write(fd, data + 1, size - 1) == (ssize_t)(size - 1));
    char path[40];
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    const mn_read_desc desc = {.weld = data[0] % 2 != 0 ? MN_WELD_OFF : MN_WELD_ON,
                               .ram_bytes = data[0] / 2 % 2 != 0 ? 3 << 20 : 64 << 20,
                               .helper_dir = "/nowhere"};
    mn_mesh mesh;
    mn_status st = {0};
    if (mn_mesh_read(path, &desc, &mesh, &st) == MN_OK)
        check_mesh(&mesh);
    else
        MN_ASSERT(st.text[0] != 0 && mesh.corner == NULL);
    mn_mesh_free(&mesh);
    close(fd);
    return 0;
}
