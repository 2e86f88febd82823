/* Goal: what was put into tiles comes back with their cells, each parcel once, whatever is in
 * memory, and cells are as full as they may be. Method: seeded random parcels, put by threads, in
 * buffers of any size; a disk that is full. */
#include <check.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "suite.h"
#include "tiles.h"
#include "tree_fixture.h"

enum { SOURCES = 40, THREADS = 4, CELL_VERTICES = 5000 };

static uint64_t state;

static mni_sort *sort_of(const mni_tile_sample *sample, uint32_t count) {
    mn_status st = {0};
    mni_sort *sort;
    mni_sort_desc desc = {.record_bytes = sizeof *sample,
                          .key = MNI_SORT_U128,
                          .budget_bytes = MNI_SORT_BUDGET_MIN,
                          .temp_dir = "/tmp"};
    ck_assert_int_eq(mni_sort_open(&sort, &desc, &st), MN_OK);
    for (uint32_t i = 0; i < count; i++)
        mni_sort_put(sort, &sample[i]);
    ck_assert_int_eq(mni_sort_finish(sort, &st), MN_OK);
    return sort;
}

static void open_tiles(mni_tiles *t, uint32_t tiles, uint32_t samples, uint32_t keys,
                       size_t buffer_bytes) {
    mni_tile_sample *sample = calloc(samples + 1, sizeof *sample);
    mn_status st = {0};
    for (uint32_t i = 0; i < samples; i++)
        sample[i] = (mni_tile_sample){.key = fixture_random(&state) % keys, .id = i};
    mni_sort *sort = sort_of(sample, samples);
    ck_assert_int_eq(mni_tiles_open(t, tiles, sort, buffer_bytes, "/tmp", &st), MN_OK);
    mni_sort_close(sort);
    free(sample);
}

/* Keys of one place are cut between ids. */
START_TEST(samples_fall_evenly_into_tiles) {
    state = fixture_seed(71);
    for (int round = 0; round < 200; round++) {
        uint32_t tiles = 1 + fixture_random(&state) % 50, samples = fixture_random(&state) % 3000;
        uint32_t keys = 1 + fixture_random(&state) % (round % 2 ? 3 : 100000), most = 0;
        uint64_t before = state;
        mni_tiles t;
        open_tiles(&t, tiles, samples, keys, 100);
        ck_assert_uint_le(t.tiles, tiles);
        uint32_t *count = calloc(t.tiles, sizeof *count);
        for (uint32_t i = 0; i < samples; i++) {
            uint64_t key = fixture_random(&before) % keys;
            uint32_t tile = mni_tiles_find(&t, key, i);
            const mni_tile_sample *cut = t.cut;
            ck_assert_uint_lt(tile, t.tiles);
            ck_assert(tile == 0 || cut[tile].key < key ||
                      (cut[tile].key == key && cut[tile].id <= i));
            ck_assert(tile + 1 == t.tiles || cut[tile + 1].key > key ||
                      (cut[tile + 1].key == key && cut[tile + 1].id > i));
            most = ++count[tile] > most ? count[tile] : most;
        }
        ck_assert_uint_le(most, samples / tiles + 1);
        free(count);
        mni_tiles_close(&t);
    }
}
END_TEST

/* ---- parcels -------------------------------------------------------------------------------- */

typedef struct putter {
    mni_tiles *tiles;
    uint32_t thread;
    uint64_t seed;
} putter;

/* What a source has for a tile follows from both. */
static mni_parcel parcel_of(uint64_t seed, uint32_t source, uint32_t tile) {
    uint64_t own = seed + (uint64_t)source * 1000003 + (uint64_t)tile * 7919;
    mni_parcel p = {.tile = tile, .source = source};
    if (fixture_random(&own) % 3 > 0)
        return p;
    p.vertices = 1 + fixture_random(&own) % 60;
    p.nodes = fixture_random(&own) % p.vertices;
    p.points = fixture_random(&own) % 100;
    p.simplices = fixture_random(&own) % (tile % 7 == 0 ? 600 : 120);
    p.ids_bytes = fixture_random(&own) % 100;
    p.vertices_bytes = fixture_random(&own) % 3000;
    p.simplices_bytes = fixture_random(&own) % 1000;
    p.sights_bytes = fixture_random(&own) % 30;
    return p;
}

static size_t content_bytes(const mni_parcel *p) {
    return p->ids_bytes + p->vertices_bytes + p->simplices_bytes + p->sights_bytes;
}

static void *put_some(void *context) {
    const putter *p = context;
    unsigned char *bytes = malloc(1 << 16);
    for (uint32_t source = p->thread; source < SOURCES; source += THREADS)
        for (uint32_t tile = 0; tile < p->tiles->tiles; tile++) {
            mni_parcel head = parcel_of(p->seed, source, tile);
            if (head.vertices == 0)
                continue;
            memset(bytes + sizeof head, (int)(source + tile), content_bytes(&head));
            mni_tiles_put(p->tiles, &head, bytes);
        }
    free(bytes);
    return NULL;
}

static void put_all(mni_tiles *t, uint64_t seed) {
    pthread_t thread[THREADS];
    putter p[THREADS];
    for (uint32_t i = 0; i < THREADS; i++) {
        p[i] = (putter){t, i, seed};
        ck_assert_int_eq(pthread_create(&thread[i], NULL, put_some, &p[i]), 0);
    }
    for (uint32_t i = 0; i < THREADS; i++)
        pthread_join(thread[i], NULL);
}

/* Every parcel of its tiles, in order. */
static void check_crate(const mni_crate *c, uint64_t seed) {
    uint32_t next = 0, vertices = 0, nodes = 0, points = 0, simplices = 0;
    for (uint32_t tile = c->first_tile; tile < c->end_tile; tile++)
        for (uint32_t source = 0; source < SOURCES; source++) {
            mni_parcel want = parcel_of(seed, source, tile), got;
            if (want.vertices == 0)
                continue;
            ck_assert_uint_lt(next, c->parcels);
            const unsigned char *at = c->parcel[next++];
            memcpy(&got, at, sizeof got);
            want.before = got.before;
            want.before_bytes = got.before_bytes;
            ck_assert_mem_eq(&got, &want, sizeof got);
            for (size_t i = 0; i < content_bytes(&got); i++)
                if (at[sizeof got + i] != (unsigned char)(source + tile))
                    ck_abort_msg("byte %zu of parcel %u", i, next - 1);
            vertices += got.vertices;
            nodes += got.nodes;
            points += got.points;
            simplices += got.simplices;
        }
    ck_assert_uint_eq(next, c->parcels);
    ck_assert_uint_eq(vertices, c->vertices);
    ck_assert_uint_eq(nodes, c->nodes);
    ck_assert_uint_eq(points, c->points);
    ck_assert_uint_eq(simplices, c->simplices);
}

START_TEST(each_cell_gets_its_parcels) {
    static const size_t buffers[] = {100, 3000, 77777, 1 << 20, 64 << 20};
    uint64_t seed = fixture_seed(72 + (uint64_t)_i);
    state = seed;
    mni_tiles t;
    mn_status st = {0};
    open_tiles(&t, 200, 5000, 1 << 30, buffers[_i]);
    put_all(&t, seed);
    ck_assert_int_eq(mni_tiles_finish(&t, CELL_VERTICES, &st), MN_OK);
    uint64_t vertices = 0, simplices = 0;
    uint32_t tile = 0;
    ck_assert_uint_gt(t.cells, 10);
    for (uint32_t c = 0; c < t.cells; c++) {
        mni_crate crate = mni_tiles_cell(&t, c);
        ck_assert_uint_eq(crate.first_tile, tile);
        tile = crate.end_tile;
        vertices += crate.vertices;
        simplices += crate.simplices;
        uint32_t full = crate.simplices * 2 / 5; /* or by vertices */
        full = full > crate.vertices ? full : crate.vertices;
        ck_assert_uint_gt(full, CELL_VERTICES / 2);
        ck_assert_uint_lt(full, CELL_VERTICES * 3 / 2);
        ck_assert_int_eq(mni_tiles_take(&t, &crate, &st), MN_OK);
        check_crate(&crate, seed);
        mni_crate_free(&crate);
    }
    ck_assert_uint_eq(tile, t.tiles);
    ck_assert_uint_eq(vertices, t.vertices);
    ck_assert_uint_eq(simplices, t.simplices);
    ck_assert((t.spill.bytes_written == 0) == (_i == 4));
    ck_assert_uint_eq(t.spill.bytes_read, t.spill.bytes_written); /* each byte once */
    mni_tiles_close(&t);
}
END_TEST

START_TEST(nothing_is_one_cell) {
    mni_tiles t;
    mn_status st = {0};
    ck_assert_int_eq(mni_tiles_open(&t, 9, NULL, 10, "/tmp", &st), MN_OK);
    ck_assert_uint_eq(mni_tiles_find(&t, 5, 5), 0);
    ck_assert_int_eq(mni_tiles_finish(&t, CELL_VERTICES, &st), MN_OK);
    ck_assert_uint_eq(t.cells, 1);
    mni_crate crate = mni_tiles_cell(&t, 0);
    ck_assert_int_eq(mni_tiles_take(&t, &crate, &st), MN_OK);
    ck_assert_uint_eq(crate.parcels, 0);
    mni_crate_free(&crate);
    mni_tiles_close(&t);
    mni_tiles_close(&t); /* again, harmlessly */
}
END_TEST

START_TEST(a_full_disk_is_told) {
    struct rlimit limit;
    mni_tiles t;
    mn_status st = {0};
    signal(SIGXFSZ, SIG_IGN);
    state = fixture_seed(79);
    open_tiles(&t, 50, 1000, 1 << 30, 5000);
    getrlimit(RLIMIT_FSIZE, &limit);
    limit.rlim_cur = 20000;
    setrlimit(RLIMIT_FSIZE, &limit);
    put_all(&t, 1);
    ck_assert_int_eq(mni_tiles_finish(&t, CELL_VERTICES, &st), MN_NO_SPACE);
    ck_assert_ptr_nonnull(strstr(st.text, "--temp-dir"));
    mni_tiles_close(&t);
}
END_TEST

START_TEST(no_folder_is_told) {
    mni_tiles t;
    mn_status st = {0};
    ck_assert_int_eq(mni_tiles_open(&t, 9, NULL, 10, "/nowhere/at/all", &st), MN_OK);
    put_all(&t, 1);
    ck_assert_int_eq(mni_tiles_finish(&t, CELL_VERTICES, &st), MN_FAILED);
    mni_tiles_close(&t);
}
END_TEST

int main(void) {
    Suite *s = suite_create("tiles");
    TCase *t = tcase_create("tiles");
    tcase_add_test(t, samples_fall_evenly_into_tiles);
    tcase_add_loop_test(t, each_cell_gets_its_parcels, 0, 5);
    tcase_add_test(t, nothing_is_one_cell);
    tcase_add_test(t, a_full_disk_is_told);
    tcase_add_test(t, no_folder_is_told);
    suite_add_tcase(s, t);
    return suite_run(s);
}
