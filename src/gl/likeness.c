/* How alike two pictures are: PSNR of all channels, and SSIM of the luminance.
 *
 * SSIM as Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: from error visibility to
 * structural similarity", 2004, define it: means, variances and covariance under a Gaussian of 11 ×
 * 11 pixels with sigma 1.5, K1 = 0.01, K2 = 0.03, L = 255; the mean over all pixels whose window
 * lies within the picture; no scaling down before. Luminance is 0.299 R + 0.587 G + 0.114 B, not
 * rounded. The Gaussian is a product of two, so rows are filtered first, and eleven of them then:
 *
 *     row y of both ──> five filtered rows ──> ring of 11 ──> a row of the map, added up
 *                       a, b, a², b², ab
 *
 * Pure; any thread. Memory: a ring of 5 × 11 rows of doubles and two rows, until return. */
#include <math.h>
#include <stdlib.h>

#include "mn_assert.h"
#include "parts.h"

enum { WINDOW = MN_SSIM_WINDOW, MOMENTS = 5 };
static const double sigma = 1.5;
static const double c1 = (0.01 * 255) * (0.01 * 255), c2 = (0.03 * 255) * (0.03 * 255);

/* Moments of one row, `columns` each, of pictures with columns + WINDOW - 1 pixels a row. */
static void filter_row(const double *a, const double *b, const double weight[WINDOW],
                       uint32_t columns, double *out) {
    for (size_t i = 0; i < MOMENTS * (size_t)columns; i++)
        out[i] = 0;
    for (uint32_t k = 0; k < WINDOW; k++) {
        const double w = weight[k];
        for (uint32_t x = 0; x < columns; x++) {
            const double p = a[x + k], q = b[x + k];
            out[x] += w * p;
            out[columns + x] += w * q;
            out[2 * (size_t)columns + x] += w * (p * p);
            out[3 * (size_t)columns + x] += w * (q * q);
            out[4 * (size_t)columns + x] += w * (p * q);
        }
    }
}

/* Sum of the map over the row whose window's last row is `last`. */
static double map_row(const double *ring, const double weight[WINDOW], uint32_t columns,
                      uint32_t last) {
    const size_t row = MOMENTS * (size_t)columns;
    double sum = 0;
    for (uint32_t x = 0; x < columns; x++) {
        double moment[MOMENTS] = {0};
        for (uint32_t k = 0; k < WINDOW; k++)
            for (uint32_t m = 0; m < MOMENTS; m++)
                moment[m] +=
                    weight[k] * ring[(last + 1 + k) % WINDOW * row + m * (size_t)columns + x];
        const double aa = moment[0] * moment[0], bb = moment[1] * moment[1],
                     ab = moment[0] * moment[1];
        sum += (2 * ab + c1) * (2 * (moment[4] - ab) + c2) /
               ((aa + bb + c1) * (moment[2] - aa + (moment[3] - bb) + c2));
    }
    return sum;
}

static void luminance(const uint8_t *rgb, uint32_t width, double *out) {
    for (uint32_t x = 0; x < width; x++)
        out[x] = 0.299 * rgb[3 * x] + 0.587 * rgb[3 * x + 1] + 0.114 * rgb[3 * x + 2];
}

static bool ssim(const uint8_t *a, const uint8_t *b, uint32_t width, uint32_t height, double *out) {
    const uint32_t columns = width - WINDOW + 1;
    const size_t row = MOMENTS * (size_t)columns;
    double *memory = malloc((WINDOW * row + 2 * (size_t)width) * sizeof *memory);
    if (memory == NULL)
        return false;
    double *ring = memory, *row_a = memory + WINDOW * row, *row_b = row_a + width;
    double weight[WINDOW], total = 0, sum = 0;
    for (int k = 0; k < WINDOW; k++) {
        weight[k] = exp(-(k - WINDOW / 2) * (k - WINDOW / 2) / (2 * sigma * sigma));
        total += weight[k];
    }
    for (int k = 0; k < WINDOW; k++)
        weight[k] /= total;
    for (uint32_t y = 0; y < height; y++) {
        luminance(a + 3 * (size_t)width * y, width, row_a);
        luminance(b + 3 * (size_t)width * y, width, row_b);
        filter_row(row_a, row_b, weight, columns, ring + y % WINDOW * row);
        if (y + 1 >= WINDOW)
            sum += map_row(ring, weight, columns, y);
    }
    *out = sum / ((double)columns * (height - WINDOW + 1));
    free(memory);
    return true;
}

mn_code mni_likeness(const uint8_t *a, const uint8_t *b, uint32_t width, uint32_t height,
                     mn_likeness *out, mn_status *st) {
    MN_ASSERT(width > 0 && height > 0);
    const size_t bytes = 3 * (size_t)width * height;
    uint64_t squares = 0;
    *out = (mn_likeness){.ssim = NAN};
    for (size_t i = 0; i < bytes; i++) {
        const uint32_t d = (uint32_t)abs(a[i] - b[i]);
        squares += d * d;
        out->difference_max = d > out->difference_max ? d : out->difference_max;
    }
    out->mean_square = (double)squares / (double)bytes;
    out->psnr_db = mn_psnr_db(out->mean_square);
    if (width >= WINDOW && height >= WINDOW && !ssim(a, b, width, height, &out->ssim))
        return mn_fail(st, MN_FAILED, "no memory to compare pictures of %u x %u", width, height);
    return MN_OK;
}
