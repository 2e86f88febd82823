/* Pictures as PNG. Hides libpng and its ways of failing.
 *
 * Written as every output is (src/io/file.h): a picture is there whole or not at all, whoever
 * interrupts, and what is no regular file stays. Any thread; memory: to write, a row, what libpng
 * and a mni_out take, until return; to read, the picture, which the caller frees. */
#include "parts.h"

#include <errno.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "file.h"

enum { SIDE_MAX = 16384 }; /* of a picture that is read: what is drawn is no larger */

/* ---- writing --------------------------------------------------------------------------------- */

/* Where the bytes go, and what went wrong first: with the file, or else what libpng says. */
typedef struct sink {
    mni_out out;
    mn_status *st;
    char error[128];
} sink;

/* libpng reports here and must not return: the text is kept for the status, then back. */
static void on_error(png_structp png, png_const_charp text) {
    sink *to = png_get_error_ptr(png);
    snprintf(to->error, sizeof to->error, "%s", text);
    png_longjmp(png, 1);
}

static void on_warning(png_structp png, png_const_charp text) {
    (void)png;
    (void)text;
}

static void put(png_structp png, png_bytep bytes, size_t count) {
    sink *to = png_get_io_ptr(png);
    if (mni_out_write(&to->out, bytes, count, to->st) != MN_OK)
        png_error(png, "it cannot be written");
}

/* mni_out_commit syncs. */
static void flush(png_structp png) {
    (void)png;
}

/* All that may longjmp; no local is changed between setjmp and the jump. */
static bool encode(sink *to, uint32_t width, uint32_t height, const uint8_t *rgba) {
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, to, on_error, on_warning);
    png_infop info = png != NULL ? png_create_info_struct(png) : NULL;
    if (info == NULL || setjmp(png_jmpbuf(png)) != 0) {
        png_destroy_write_struct(&png, &info);
        return false;
    }
    png_set_write_fn(png, to, put, flush);
    png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png, info);
    png_set_filler(png, 0, PNG_FILLER_AFTER); /* drops alpha */
    for (uint32_t y = height; y-- > 0;)
        png_write_row(png, rgba + 4 * (size_t)width * y);
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    return true;
}

mn_code mni_png_write(const char *path, uint32_t width, uint32_t height, const uint8_t *rgba,
                      mn_status *st) {
    sink to = {.st = st, .error = "no memory"};
    const mn_code code = mni_out_open(&to.out, path, st);
    if (code != MN_OK)
        return code;
    if (encode(&to, width, height, rgba))
        return mni_out_commit(&to.out, st);
    const mn_code failed = to.out.failed;
    mni_out_abort(&to.out);
    return failed != MN_OK ? failed : mn_fail(st, MN_FAILED, "%s: no picture: %s", path, to.error);
}

/* ---- reading --------------------------------------------------------------------------------- */

/* The rest of a picture whose header has been read. libpng's simple interface returns what went
 * wrong instead of jumping, and ends itself. */
static mn_code read_pixels(const char *path, png_image *image, uint8_t **rgb, mn_status *st) {
    static const png_color black = {0, 0, 0};
    if (image->width > SIDE_MAX || image->height > SIDE_MAX)
        return mn_fail(st, MN_BAD_INPUT, "%s: %u x %u pixels: more than %d each way", path,
                       image->width, image->height, SIDE_MAX);
    image->format = PNG_FORMAT_RGB;
    uint8_t *pixels = malloc(PNG_IMAGE_SIZE(*image));
    if (pixels == NULL)
        return mn_fail(st, MN_FAILED, "%s: no memory for %u x %u pixels", path, image->width,
                       image->height);
    if (!png_image_finish_read(image, &black, pixels, 0, NULL)) {
        free(pixels);
        return mn_fail(st, MN_BAD_INPUT, "%s: a damaged PNG: %s", path, image->message);
    }
    *rgb = pixels;
    return MN_OK;
}

mn_code mni_png_read(const char *path, uint8_t **rgb, uint32_t *width, uint32_t *height,
                     mn_status *st) {
    struct stat info;
    *rgb = NULL;
    if (stat(path, &info) == 0 && !S_ISREG(info.st_mode)) /* a fifo would be waited for */
        return mn_fail(st, MN_BAD_INPUT, "%s: not a file", path);
    FILE *file = fopen(path, "rbe");
    if (file == NULL)
        return mn_fail(st, errno == ENOENT ? MN_BAD_INPUT : MN_FAILED, "%s: cannot be read: %s",
                       path, strerror(errno));
    png_image image = {.version = PNG_IMAGE_VERSION};
    mn_code code;
    if (png_image_begin_read_from_stdio(&image, file)) {
        *width = image.width;
        *height = image.height;
        code = read_pixels(path, &image, rgb, st);
    } else {
        code = mn_fail(st, MN_BAD_INPUT, "%s: not a PNG: %s", path, image.message);
    }
    png_image_free(&image);
    fclose(file);
    return code;
}
