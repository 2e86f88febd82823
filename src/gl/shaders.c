/* The shaders, GLSL 3.30. Lengths are relative to the eye, in units of about the model's radius
 * (render.c says why); light is linear until the last line of a fragment shader. Lights stand with
 * the camera, so no view is dark. */
#include "parts.h"

#define TEXT(...) #__VA_ARGS__
#define TEXT_OF(...) TEXT(__VA_ARGS__)
#define KEY_LIGHT TEXT_OF(MN_LIGHT_KEY)

/* Positions become relative to the eye before anything else: far from the file's origin, but near
 * the surface, the difference is exact where a product with one matrix would jitter. */
const char mni_shader_surface_vertex[] =
    "#version 330 core\n"
    "layout(location = 0) in vec3 position;\n"
    "layout(location = 1) in vec4 normal;\n"
    "layout(location = 2) in vec4 color;\n"
    "layout(location = 3) in float switch_value;\n"
    "uniform vec3 eye;\n"
    "uniform float unit;\n" /* units a length of the model */
    "uniform mat3 view;\n"
    "uniform vec2 scale;\n"       /* x, y of the projection */
    "uniform vec2 depth;\n"       /* clip z = depth.x * z + depth.y */
    "uniform float inv_radius;\n" /* 1 / radius of the model */
    "uniform int paint;\n"        /* 0 clay, 1 vertex colours, 2 level of detail */
    "out vec3 v_at;\n"
    "out vec3 v_normal;\n"
    "out vec3 v_color;\n"
    "vec3 ramp(float t) {\n" /* blue, cyan, green, yellow, red */
    "    return clamp(vec3(1.5) - abs(4.0 * vec3(t) - vec3(3.4, 2.0, 0.6)), 0.12, 0.88);\n"
    "}\n"
    "void main() {\n"
    "    vec3 p = view * ((position - eye) * unit);\n"
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

/* Normals at the corners. Where a vertex' smooth normal is far off the triangle's own, turned to
 * the eye (32 to 44 degrees; on a right-angled edge it is 45), the corner takes the latter: sharp
 * edges stay sharp and the faces beside them plain. But a triangle only a few pixels high (2 to 8)
 * may be a sliver that stands askew, as scans and coarse fronts have them: lit as its neighbours
 * are, or pictures would have specks and seem to have cracks. One that stands as the surface does
 * at one of its corners (4 to 8 degrees) is not askew, however low: it lies in a face. Two-sided:
 * open meshes show their backs, where smooth normals must be turned; a triangle folded over, or
 * wound wrongly, shows its back among neighbours that do not, and is left alone. */
const char mni_shader_surface_geometry[] =
    "#version 330 core\n"
    "layout(triangles) in;\n"
    "layout(triangle_strip, max_vertices = 3) out;\n"
    "in vec3 v_at[];\n"
    "in vec3 v_normal[];\n"
    "in vec3 v_color[];\n"
    "uniform bool flat_shading;\n"
    "uniform float px_scale;\n" /* pixels of 1 at distance 1 */
    "out vec3 g_at, g_edge;\n"  /* g_edge: barycentric coordinates */
    "out vec3 g_normal, g_color;\n"
    "void main() {\n"
    "    vec3 a = v_at[1] - v_at[0], b = v_at[2] - v_at[0], c = v_at[2] - v_at[1];\n"
    "    vec3 middle = (v_at[0] + v_at[1] + v_at[2]) / 3.0, eye = -normalize(middle);\n"
    "    vec3 n = cross(a, b);\n"
    "    float twice_area = length(n);\n"
    "    n = twice_area > 0.0 ? n / twice_area : eye;\n"
    "    bool front = dot(n, eye) >= 0.0;\n"
    "    if (!front) n = -n;\n"
    "    vec3 mean = v_normal[0] + v_normal[1] + v_normal[2];\n"
    "    mean = dot(mean, mean) > 0.0 ? normalize(mean) : n;\n"
    "    bool back = !front && (dot(mean, eye) < -0.1 || dot(mean, n) < -0.5);\n"
    "    float longest = sqrt(max(dot(a, a), max(dot(b, b), dot(c, c))));\n"
    "    float height_px = px_scale * twice_area / max(longest * length(middle), 1e-37);\n"
    "    float trust = flat_shading ? 1.0 : smoothstep(2.0, 8.0, height_px);\n"
    "    vec3 along = vec3(dot(n, v_normal[0]), dot(n, v_normal[1]), dot(n, v_normal[2]));\n"
    "    along *= back ? -1.0 : 1.0;\n"
    "    trust = max(trust, smoothstep(0.99, 0.998, max(along.x, max(along.y, along.z))));\n"
    "    vec3 normal[3];\n"
    "    for (int i = 0; i < 3; i++) {\n"
    "        vec3 s = back ? -v_normal[i] : v_normal[i];\n"
    "        float own = trust * (1.0 - smoothstep(0.72, 0.85, dot(n, s)));\n"
    "        if (flat_shading || dot(s, s) < 0.25) own = 1.0;\n" /* or no smooth one */
    "        normal[i] = mix(s, n, own);\n"
    "    }\n"
    "    vec3 one = (normal[0] + normal[1] + normal[2]) / 3.0;\n"
    "    vec3 color = (v_color[0] + v_color[1] + v_color[2]) / 3.0;\n"
    "    float thin = 1.0 - smoothstep(0.5, 1.5, height_px * abs(dot(n, eye)));\n"
    "    for (int i = 0; i < 3; i++) {\n"
    "        gl_Position = gl_in[i].gl_Position;\n"
    "        g_at = v_at[i];\n"
    "        g_edge = vec3(i == 0, i == 1, i == 2);\n"
    "        g_normal = mix(normal[i], one, thin);\n"
    "        g_color = mix(v_color[i], color, thin);\n"
    "        EmitVertex();\n"
    "    }\n"
    "    EndPrimitive();\n"
    "}\n";

/* Never black: a normal that looks away from the eye, as on outlines, is turned to the horizon. The
 * cosine of two unit vectors is rounded to more than 1 now and then, and pow of less than 0 is what
 * the driver likes: NaN, a black pixel, on some. */
#define SURFACE_LIGHT                                                                              \
    "vec3 facing_normal(vec3 at, vec3 normal) {\n"                                                 \
    "    vec3 v = -normalize(at);\n"                                                               \
    "    vec3 s = dot(normal, normal) > 1e-4 ? normalize(normal) : v;\n"                           \
    "    return normalize(s + v * max(0.05 - dot(s, v), 0.0));\n"                                  \
    "}\n"                                                                                          \
    "float lobe(vec3 n, vec3 l, vec3 v, float power) {\n"                                          \
    "    return pow(max(dot(n, normalize(l + v)), 0.0), power);\n"                                 \
    "}\n"                                                                                          \
    "vec3 lit(vec3 albedo, vec3 n, vec3 at) {\n"                                                   \
    "    const vec3 key = vec3(" KEY_LIGHT "), fill = vec3(0.784, -0.098, 0.613);\n"               \
    "    vec3 v = normalize(-at);\n"                                                               \
    "    float k = max(dot(n, key) * 0.95 + 0.05, 0.0), f = max(dot(n, fill) * 0.8 + 0.2, 0.0);\n" \
    "    vec3 sky = mix(vec3(0.07, 0.06, 0.055), vec3(0.17, 0.19, 0.22), n.y * 0.5 + 0.5);\n"      \
    "    vec3 light = sky + k * vec3(1.08, 1.04, 0.97) + f * vec3(0.13, 0.15, 0.19);\n"            \
    "    float shine = 0.07 * lobe(n, key, v, 40.0) + 0.015 * lobe(n, fill, v, 18.0);\n"           \
    "    float rim = 0.05 * pow(1.0 - clamp(dot(n, v), 0.0, 1.0), 4.0);\n"                         \
    "    return albedo * light + vec3(shine + rim);\n"                                             \
    "}\n"

const char mni_shader_surface_fragment[] =
    "#version 330 core\n"
    "in vec3 g_at;\n"
    "in vec3 g_normal, g_color;\n"
    "out vec4 pixel;\n" SURFACE_LIGHT "void main() {\n"
    "    vec3 n = facing_normal(g_at, g_normal);\n"
    "    pixel = vec4(pow(lit(g_color, n, g_at), vec3(1.0 / 2.2)), 1.0);\n"
    "}\n";

/* A line is one pixel wide; it fades where triangles get as small as pixels, so that a dense mesh
 * stays readable as a surface. */
const char mni_shader_wire_fragment[] =
    "#version 330 core\n"
    "in vec3 g_at, g_edge;\n"
    "in vec3 g_normal, g_color;\n"
    "out vec4 pixel;\n" SURFACE_LIGHT "void main() {\n"
    "    vec3 n = facing_normal(g_at, g_normal);\n"
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
