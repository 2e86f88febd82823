/* subdivide: Loop's scheme, for models with smooth detail (`metanode make subdivide`). */
#include "mesh.h"
#include "stream.h"

#include <OpenMesh/Tools/Subdivider/Uniform/LoopT.hh>

void run_subdivide(const arguments &given) {
    arguments args = given;
    uint64_t times = number(take_option(args, "--times"), "--times", 1, 15);
    halfedge_mesh mesh;
    {
        soup in = stream_read();
        if (in.triangles() << 2 * times > INT32_MAX / 3)
            throw trouble("the result would have more edges than OpenMesh can number");
        in.color.clear();
        fill(mesh, in);
    }
    OpenMesh::Subdivider::Uniform::LoopT<halfedge_mesh> loop;
    if (!loop.attach(mesh) || !loop(times))
        throw trouble("OpenMesh cannot subdivide it");
    loop.detach();
    stream_write(gather(mesh));
}
