/* The shaders, GLSL 3.30. Units: lengths in model units relative to the eye; light is linear until
 * the last line of a fragment shader. Lights stand with the camera, so no view is dark. */
#include "parts.h"

/* Positions become relative to the eye before anything else: far from the file's origin, but near
 * the surface, the difference is exact where a product with one matrix would jitter. */
const char mni_shader_surface_vertex[] =
    "#version 330 core\n"
    "layout(location = 0) in vec3 position;\n"
    "layout(location = 1) in vec4 normal;\n"
    "layout(location = 2) in vec4 color;\n"
    "layout(location = 3) in float switch_value;\n"
    "uniform vec3 eye;\n"
    "uniform mat3 view;\n"
    "uniform vec2 scale;\n"       /* x, y of the projection */
    "uniform vec2 depth;\n"       /* clip z = depth.x * z + depth.y */
    "uniform float inv_radius;\n" /* 1 / radius of the model */
    "uniform int paint;\n"        /* 0 clay, 1 vertex colours, 2 level of detail */
    "out vec3 v_at;\n"
    "centroid out vec3 v_normal;\n"
    "centroid out vec3 v_color;\n"
    "vec3 ramp(float t) {\n" /* blue, cyan, green, yellow, red */
    "    return clamp(vec3(1.5) - abs(4.0 * vec3(t) - vec3(3.4, 2.0, 0.6)), 0.12, 0.88);\n"
    "}\n"
    "void main() {\n"
    "    vec3 p = view * (position - eye);\n"
    "    gl_Position = vec4(scale * p.xy, depth.x * p.z + depth.y, -p.z);\n"
    "    v_at = p;\n"
    "    v_normal = view * normal.xyz;\n"
    "    v_color = vec3(0.60, 0.54, 0.47);\n"
    "    if (paint == 1)\n"
    "        v_color = 0.8 * pow(color.rgb, vec3(2.2));\n"
    "    if (paint == 2) {\n" /* 1e-4 … 1e-1 of the radius */
    "        float e = log2(max(switch_value * inv_radius, 1e-4)) * 0.30103;\n"
    "        v_color = pow(ramp(clamp((e + 4.0) * 0.3333, 0.0, 1.0)), vec3(1.6));\n"
    "    }\n"
    "}\n";

#define SURFACE_LIGHT                                                                              \
    "uniform bool flat_shading;\n"                                                                 \
    "vec3 facing_normal(vec3 at, vec3 smooth_normal, bool front) {\n"                              \
    "    vec3 n = cross(dFdx(at), dFdy(at));\n" /* the triangle's own, towards the eye */          \
    "    n = dot(n, n) > 0.0 ? normalize(n) : vec3(0.0, 0.0, 1.0);\n"                              \
    "    if (dot(n, at) > 0.0) n = -n;\n"                                                          \
    "    if (flat_shading || dot(smooth_normal, smooth_normal) < 1e-4) return n;\n"                \
    "    vec3 v = -normalize(at), s = normalize(smooth_normal);\n"                                 \
    "    if (!front && dot(s, v) < 0.2) s = -s;\n"                                                 \
    "    float agree = dot(n, s);\n"                                                               \
    "    s = mix(s, n, smoothstep(0.25, 0.45, agree) * (1.0 - smoothstep(0.6, 0.85, agree)));\n"   \
    "    return normalize(s + v * max(0.05 - dot(s, v), 0.0));\n"                                  \
    "}\n"                                                                                          \
    "float lobe(vec3 n, vec3 l, vec3 v, float power) {\n"                                          \
    "    return pow(max(dot(n, normalize(l + v)), 0.0), power);\n"                                 \
    "}\n"                                                                                          \
    "vec3 lit(vec3 albedo, vec3 n, vec3 at) {\n"                                                   \
    "    const vec3 key = vec3(-0.441, 0.606, 0.662), fill = vec3(0.784, -0.098, 0.613);\n"        \
    "    vec3 v = normalize(-at);\n"                                                               \
    "    float k = max(dot(n, key) * 0.95 + 0.05, 0.0), f = max(dot(n, fill) * 0.8 + 0.2, 0.0);\n" \
    "    vec3 sky = mix(vec3(0.07, 0.06, 0.055), vec3(0.17, 0.19, 0.22), n.y * 0.5 + 0.5);\n"      \
    "    vec3 light = sky + k * vec3(1.08, 1.04, 0.97) + f * vec3(0.13, 0.15, 0.19);\n"            \
    "    float shine = 0.07 * lobe(n, key, v, 40.0) + 0.015 * lobe(n, fill, v, 18.0);\n"           \
    "    float rim = 0.05 * pow(1.0 - max(dot(n, v), 0.0), 4.0);\n"                                \
    "    return albedo * light + vec3(shine + rim);\n"                                             \
    "}\n"

/* Two-sided: open meshes show their backs. Creases are kept: where the smooth normal is 30 to 75
 * degrees off the triangle's own, the latter takes over. Further off, the triangle is a sliver on
 * edge or folded over, as coarse fronts have them, and is lit as its neighbours are. */
const char mni_shader_surface_fragment[] =
    "#version 330 core\n"
    "in vec3 v_at;\n"
    "centroid in vec3 v_normal;\n"
    "centroid in vec3 v_color;\n"
    "out vec4 pixel;\n" SURFACE_LIGHT "void main() {\n"
    "    vec3 n = facing_normal(v_at, v_normal, gl_FrontFacing);\n"
    "    pixel = vec4(pow(lit(v_color, n, v_at), vec3(1.0 / 2.2)), 1.0);\n"
    "}\n";

/* Wireframe: each triangle carries its barycentric coordinates. */
const char mni_shader_wire_geometry[] = "#version 330 core\n"
                                        "layout(triangles) in;\n"
                                        "layout(triangle_strip, max_vertices = 3) out;\n"
                                        "in vec3 v_at[];\n"
                                        "centroid in vec3 v_normal[];\n"
                                        "centroid in vec3 v_color[];\n"
                                        "out vec3 g_at, g_edge;\n"
                                        "centroid out vec3 g_normal, g_color;\n"
                                        "void main() {\n"
                                        "    for (int i = 0; i < 3; i++) {\n"
                                        "        gl_Position = gl_in[i].gl_Position;\n"
                                        "        g_at = v_at[i];\n"
                                        "        g_normal = v_normal[i];\n"
                                        "        g_color = v_color[i];\n"
                                        "        g_edge = vec3(i == 0, i == 1, i == 2);\n"
                                        "        EmitVertex();\n"
                                        "    }\n"
                                        "    EndPrimitive();\n"
                                        "}\n";

/* A line is one pixel wide; it fades where triangles get as small as pixels, so that a dense mesh
 * stays readable as a surface. */
const char mni_shader_wire_fragment[] =
    "#version 330 core\n"
    "in vec3 g_at, g_edge;\n"
    "centroid in vec3 g_normal, g_color;\n"
    "out vec4 pixel;\n" SURFACE_LIGHT "void main() {\n"
    "    vec3 n = facing_normal(g_at, g_normal, gl_FrontFacing);\n"
    "    vec3 c = pow(lit(g_color, n, g_at), vec3(1.0 / 2.2));\n"
    "    vec3 w = max(fwidth(g_edge), vec3(1e-7));\n"
    "    vec3 d = g_edge / w;\n"
    "    float line = 1.0 - smoothstep(0.25, 1.0, min(d.x, min(d.y, d.z)));\n"
    "    float small = max(w.x, max(w.y, w.z));\n" /* 1 / height of the triangle in pixels */
    "    line *= mix(0.85, 0.25, smoothstep(0.08, 0.5, small));\n"
    "    pixel = vec4(mix(c, vec3(0.05, 0.07, 0.11), line), 1.0);\n"
    "}\n";

/* One triangle over the whole picture. Alpha 0: no mesh here. */
const char mni_shader_sky_vertex[] =
    "#version 330 core\n"
    "out float v_height;\n"
    "void main() {\n"
    "    vec2 p = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);\n"
    "    v_height = p.y * 0.5 + 0.5;\n"
    "    gl_Position = vec4(p, 0.0, 1.0);\n"
    "}\n";

const char mni_shader_sky_fragment[] =
    "#version 330 core\n"
    "in float v_height;\n"
    "out vec4 pixel;\n"
    "void main() {\n"
    "    pixel = vec4(mix(vec3(0.80, 0.82, 0.84), vec3(0.42, 0.47, 0.54), v_height), 0.0);\n"
    "}\n";
