/* See made_model.h. */
#include "made_model.h"

#include <check.h>
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

made_model made_load(const char *path) {
    FILE *f = fopen(path, "rb");
    ck_assert_ptr_nonnull(f);
    made_model m = {0};
    char line[512];
    do {
        ck_assert_ptr_nonnull(fgets(line, sizeof line, f));
        unsigned long long n;
        if (sscanf(line, "element vertex %llu", &n) == 1)
            m.vertices = n;
        if (sscanf(line, "element face %llu", &n) == 1)
            m.triangles = n;
    } while (strcmp(line, "end_header\n") != 0);
    m.position = malloc(12 * m.vertices);
    m.corner = malloc(12 * m.triangles);
    XXH3_state_t *hash = XXH3_createState();
    XXH3_64bits_reset(hash);
    unsigned char record[15];
    for (uint64_t v = 0; v < m.vertices; v++) {
        ck_assert_uint_eq(fread(record, 15, 1, f), 1);
        memcpy(m.position + 3 * v, record, 12);
        XXH3_64bits_update(hash, record, 15);
    }
    for (uint64_t t = 0; t < m.triangles; t++) {
        ck_assert_uint_eq(fread(record, 13, 1, f), 1);
        ck_assert_uint_eq(record[0], 3);
        memcpy(m.corner + 3 * t, record + 1, 12);
        XXH3_64bits_update(hash, record, 13);
    }
    ck_assert_int_eq(fgetc(f), EOF);
    fclose(f);
    m.hash = XXH3_64bits_digest(hash);
    XXH3_freeState(hash);
    return m;
}

void made_drop(made_model *m) {
    free(m->position);
    free(m->corner);
}

static int compare_u64(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

uint64_t made_check_edges(const made_model *m, uint64_t *edges) {
    uint64_t n = 3 * m->triangles, *key = malloc(8 * n), alone = 0;
    for (uint64_t t = 0; t < m->triangles; t++)
        for (int i = 0; i < 3; i++) {
            uint64_t a = m->corner[3 * t + i], b = m->corner[3 * t + (i + 1) % 3];
            ck_assert(a != b && a < m->vertices);
            key[3 * t + i] = a << 32 | b;
        }
    qsort(key, n, 8, compare_u64);
    for (uint64_t i = 0; i < n; i++) {
        ck_assert_msg(i == 0 || key[i] != key[i - 1], "a directed edge twice");
        uint64_t back = key[i] << 32 | key[i] >> 32;
        alone += bsearch(&back, key, n, 8, compare_u64) == NULL;
    }
    free(key);
    *edges = (n + alone) / 2;
    return alone;
}

void made_check_fans(const made_model *m) {
    uint32_t *parent = malloc(12 * m->triangles), *count = calloc(m->vertices, 4);
    uint64_t n = 3 * m->triangles, *key = malloc(16 * n); /* (edge, corner slot) at both its ends */
    for (uint64_t i = 0; i < n; i++) {
        parent[i] = (uint32_t)i;
        count[m->corner[i]]++;
    }
    /* the triangle on the other side shares both ends: join the slots at each end */
    for (uint64_t i = 0; i < n; i++) {
        uint64_t next = i / 3 * 3 + (i + 1) % 3;
        uint64_t a = m->corner[i], b = m->corner[next];
        key[2 * i] = a < b ? a << 32 | b : b << 32 | a;
        key[2 * i + 1] = i;
    }
    qsort(key, n, 16, compare_u64);
    uint64_t fans = n;
    for (uint64_t i = 1; i < n; i++) {
        if (key[2 * i] != key[2 * i - 2])
            continue;
        for (int end = 0; end < 2; end++) {
            uint64_t slot[2];
            for (int k = 0; k < 2; k++) {
                uint64_t e = key[2 * (i - (uint64_t)k) + 1], next = e / 3 * 3 + (e + 1) % 3;
                uint32_t want = (uint32_t)(end ? key[2 * i] >> 32 : key[2 * i]);
                slot[k] = m->corner[e] == want ? e : next;
                while (parent[slot[k]] != slot[k])
                    slot[k] = parent[slot[k]] = parent[parent[slot[k]]];
            }
            fans -= slot[0] != slot[1];
            parent[slot[0]] = (uint32_t)slot[1];
        }
    }
    for (uint64_t v = 0; v < m->vertices; v++)
        ck_assert_msg(count[v] > 0, "vertex %llu is unused", (unsigned long long)v);
    ck_assert_uint_eq(fans, m->vertices);
    free(parent);
    free(count);
    free(key);
}

static int compare_point(const void *a, const void *b) {
    return memcmp(a, b, 12);
}

void made_check_positions(const made_model *m) {
    for (uint64_t i = 0; i < 3 * m->vertices; i++) {
        ck_assert(isfinite(m->position[i]));
        m->position[i] += 0.0f; /* -0 */
    }
    float *sorted = malloc(12 * m->vertices);
    memcpy(sorted, m->position, 12 * m->vertices);
    qsort(sorted, m->vertices, 12, compare_point);
    for (uint64_t v = 1; v < m->vertices; v++)
        ck_assert_int_ne(memcmp(sorted + 3 * v - 3, sorted + 3 * v, 12), 0);
    free(sorted);
}

double made_volume(const made_model *m) {
    double sum = 0;
    for (uint64_t t = 0; t < m->triangles; t++) {
        const float *a = m->position + 3 * m->corner[3 * t];
        const float *b = m->position + 3 * m->corner[3 * t + 1];
        const float *c = m->position + 3 * m->corner[3 * t + 2];
        sum += a[0] * ((double)b[1] * c[2] - (double)b[2] * c[1]) +
               a[1] * ((double)b[2] * c[0] - (double)b[0] * c[2]) +
               a[2] * ((double)b[0] * c[1] - (double)b[1] * c[0]);
    }
    return sum / 6;
}

int made_files(const char *folder) {
    DIR *d = opendir(folder);
    int count = 0;
    for (struct dirent *e; (e = readdir(d)) != NULL;)
        count += e->d_name[0] != '.' || strlen(e->d_name) > 2;
    closedir(d);
    return count;
}
