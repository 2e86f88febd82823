/* See rowpack_write.h. Hidden here: that where pages begin stands in a file of its own until all of
 * them are written, and is then copied behind them. Paper: none. */
#include "rowpack_write.h"

static mn_code trouble(const mni_spill *spill, mn_status *st) {
    return mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
}

static void put_page(mni_rowpack_writer *w, const unsigned char *packed, size_t bytes) {
    mni_spill_put(&w->places, &w->file_bytes, sizeof w->file_bytes);
    mni_spill_put(&w->file, packed, bytes);
    w->file_bytes += bytes;
}

static void put_rows(mni_rowpack_writer *w) {
    unsigned char packed[MNI_PAGE_PACKED_MAX];
    if (w->in_page == 0)
        return;
    XXH3_64bits_update(&w->sum[MNI_ROWS], w->page, w->in_page * sizeof *w->page);
    put_page(w, packed, mni_rows_pack(packed, w->page, w->rows, w->in_page, w->grid_step));
    w->rows += w->in_page;
    w->in_page = 0;
}

static void put_simplices(mni_rowpack_writer *w) {
    unsigned char packed[MNI_PAGE_PACKED_MAX];
    const uint32_t count = w->simplices_in_page;
    if (count == 0)
        return;
    XXH3_64bits_update(&w->sum[MNI_SIMPLICES], w->simplices, count * sizeof *w->simplices);
    put_page(w, packed, mni_simplices_pack(packed, w->simplices, count));
    w->simplices_in_page = 0;
}

void mni_rowpack_open(mni_rowpack_writer *w, mni_spill *file, mni_rowpack_buffer file_buffer,
                      mni_spill *places, mni_rowpack_buffer places_buffer, float grid_step) {
    mni_spill_writer_open(&w->file, file, file_buffer.bytes, file_buffer.count);
    mni_spill_writer_open(&w->places, places, places_buffer.bytes, places_buffer.count);
    w->grid_step = grid_step;
    w->file_bytes = 0;
    w->rows = w->in_page = w->simplices_in_page = 0;
    for (int i = 0; i < MNI_SECTIONS; i++)
        XXH3_64bits_reset(&w->sum[i]);
}

void mni_rowpack_row(mni_rowpack_writer *w, const mni_row *row) {
    w->page[w->in_page++] = *row;
    if (w->in_page == MNI_ROWS_PAGE)
        put_rows(w);
}

void mni_rowpack_simplex(mni_rowpack_writer *w, const mni_row_simplex *simplex) {
    put_rows(w); /* all of them have come */
    w->simplices[w->simplices_in_page++] = *simplex;
    if (w->simplices_in_page == MNI_SIMPLICES_PAGE)
        put_simplices(w);
}

mn_code mni_rowpack_end(mni_rowpack_writer *w, mni_rowpack_buffer buffer,
                        uint64_t sum[MNI_SECTIONS], mn_status *st) {
    mni_spill *const places = w->places.spill;
    mni_spill_reader from;
    const uint64_t *place;
    put_rows(w);
    put_simplices(w);
    mni_spill_put(&w->places, &w->file_bytes, sizeof w->file_bytes);
    for (int i = 0; i < MNI_SECTIONS; i++)
        sum[i] = XXH3_64bits_digest(&w->sum[i]);
    if (mni_spill_end(&w->places) != MN_OK)
        return trouble(places, st);
    mni_spill_reader_open(&from, places, 0, places->size_bytes, buffer.bytes, buffer.count, true);
    while ((place = mni_spill_take(&from, sizeof *place)) != NULL)
        mni_spill_put(&w->file, place, sizeof *place);
    if (mni_spill_end(&w->file) != MN_OK)
        return trouble(w->file.spill, st);
    return places->trouble.code != MN_OK ? trouble(places, st) : MN_OK;
}
