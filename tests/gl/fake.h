/* Fronts made by hand: what a session would hand to the renderer, with a hinge and an empty slot
 * among the triangles. */
#ifndef TESTS_GL_FAKE_H
#define TESTS_GL_FAKE_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "metanode/gl.h"

typedef struct fake {
    float *position, *switch_value;
    uint32_t *color, *node;
    mn_front front;
    mn_gl_desc desc;
} fake;

static inline void fake_free(fake *f) {
    free(f->position);
    free(f->switch_value);
    free(f->color);
    free(f->node);
}

static inline void fake_triangle(fake *f, uint32_t a, uint32_t b, uint32_t c) {
    uint32_t *v = f->node + 3 * f->front.simplex_slots++;
    v[0] = a;
    v[1] = b;
    v[2] = c;
    f->front.triangles += a != MN_NONE && c != MN_NONE;
}

/* A grid of n × n squares; the caller places its (n + 1)² nodes. */
static inline fake fake_grid(uint32_t n, uint32_t width, uint32_t height) {
    const uint32_t nodes = (n + 1) * (n + 1);
    fake f = {.position = calloc(3 * nodes, sizeof(float)),
              .switch_value = calloc(nodes, sizeof(float)),
              .color = calloc(nodes, sizeof(uint32_t)),
              .node = calloc(3 * (2 * n * n + 2), sizeof(uint32_t))};
    f.front.node_slots = nodes;
    fake_triangle(&f, MN_NONE, MN_NONE, MN_NONE);
    for (uint32_t y = 0; y < n; y++)
        for (uint32_t x = 0; x < n; x++) {
            const uint32_t a = y * (n + 1) + x, b = a + 1, c = a + n + 1, d = c + 1;
            fake_triangle(&f, a, b, d);
            fake_triangle(&f, a, d, c);
        }
    fake_triangle(&f, 0, nodes - 1, MN_NONE);
    for (uint32_t i = 0; i < nodes; i++)
        f.switch_value[i] = 1e-4f * (float)(1 + i % (n + 1));
    f.front.position = f.position;
    f.front.switch_value = f.switch_value;
    f.front.simplex_node = f.node;
    f.desc = (mn_gl_desc){.width_px = width,
                          .height_px = height,
                          .node_slots_max = nodes,
                          .simplex_slots_max = f.front.simplex_slots,
                          .box_min = {-1, -1, -1},
                          .box_max = {1, 1, 1}};
    return f;
}

/* A globe: closed to the eye, counter-clockwise outside. */
static inline fake fake_sphere(uint32_t n, uint32_t width, uint32_t height) {
    fake f = fake_grid(n, width, height);
    for (uint32_t y = 0; y <= n; y++)
        for (uint32_t x = 0; x <= n; x++) {
            float *p = f.position + 3 * (y * (n + 1) + x);
            const double around = 2 * M_PI * (x % n) / n, down = M_PI * y / n;
            p[0] = (float)(sin(down) * sin(around));
            p[1] = (float)-cos(down);
            p[2] = (float)(sin(down) * cos(around));
        }
    return f;
}

/* A sheet in the plane z = 0 from -1 to 1, its front towards +z. */
static inline fake fake_sheet(uint32_t n, uint32_t width, uint32_t height) {
    fake f = fake_grid(n, width, height);
    for (uint32_t y = 0; y <= n; y++)
        for (uint32_t x = 0; x <= n; x++) {
            float *p = f.position + 3 * (y * (n + 1) + x);
            p[0] = -1 + 2 * (float)x / (float)n;
            p[1] = -1 + 2 * (float)y / (float)n;
            f.color[y * (n + 1) + x] = 0xff0000ff; /* red */
        }
    return f;
}

#endif
