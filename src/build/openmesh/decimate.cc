/* decimate: OpenMesh's quadric decimater, the yardstick of `metanode bench simplify`. What is timed
 * is the processor's time for initialize and decimate_to_faces, on a mesh whose face normals stand
 * already; the figures are one line on standard error: "decimate seconds=S collapses=N
 * triangles=N". */
#include "mesh.h"
#include "stream.h"

#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModNormalFlippingT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>
#include <cstdio>
#include <time.h>

typedef OpenMesh::Decimater::DecimaterT<halfedge_mesh> decimater;
typedef OpenMesh::Decimater::ModQuadricT<halfedge_mesh>::Handle quadric;
typedef OpenMesh::Decimater::ModNormalFlippingT<halfedge_mesh>::Handle normal_flipping;

static double processor_s() {
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

void run_decimate(const arguments &given) {
    arguments args = given;
    uint64_t target = number(take_option(args, "--triangles"), "--triangles", 0, INT32_MAX);
    halfedge_mesh mesh;
    {
        soup in = stream_read();
        in.color.clear();
        fill(mesh, in);
    }
    mesh.request_face_normals();
    mesh.update_face_normals();
    decimater d(mesh);
    quadric q;
    normal_flipping n;
    d.add(q);
    d.module(q).unset_max_err();
    d.add(n);
    double start = processor_s();
    if (!d.initialize())
        throw trouble("OpenMesh cannot decimate it");
    size_t collapses = d.decimate_to_faces(0, target);
    double seconds = processor_s() - start;
    soup out = gather(mesh);
    fprintf(stderr, "decimate seconds=%.9f collapses=%zu triangles=%zu\n", seconds, collapses,
            out.triangles());
    stream_write(out);
}
