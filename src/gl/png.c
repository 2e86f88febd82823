/* Pictures as PNG. Hides libpng and its ways of failing.
 *
 * Written under a temporary name, synced, renamed: a picture is there whole or not at all, and what
 * is no regular file stays. Any thread; memory: to write, a row and what libpng takes, until
 * return; to read, the picture, which the caller frees. */
#include "parts.h"

#include <errno.h>
#include <limits.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { SIDE_MAX = 16384 }; /* of a picture that is read: what is drawn is no larger */

/* ---- writing --------------------------------------------------------------------------------- */

/* libpng reports here and must not return: an error text kept for the status, then back. */
static void on_error(png_structp png, png_const_charp text) {
    snprintf(png_get_error_ptr(png), 128, "%s", text);
    png_longjmp(png, 1);
}

static void on_warning(png_structp png, png_const_charp text) {
    (void)png;
    (void)text;
}

/* All that may longjmp; no local is changed between setjmp and the jump. */
static bool encode(FILE *file, uint32_t width, uint32_t height, const uint8_t *rgba,
                   char error[128]) {
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, error, on_error, on_warning);
    png_infop info = png != NULL ? png_create_info_struct(png) : NULL;
    if (info == NULL || setjmp(png_jmpbuf(png)) != 0) {
        png_destroy_write_struct(&png, &info);
        return false;
    }
    png_init_io(png, file);
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

static mn_code failure(const char *path, const char *why, mn_status *st) {
    const int e = errno;
    return mn_fail(st, e == ENOSPC || e == EDQUOT ? MN_NO_SPACE : MN_FAILED,
                   "cannot write picture %s: %s; is the directory there, writable, not full?", path,
                   e != 0 ? strerror(e) : why);
}

mn_code mni_png_write(const char *path, uint32_t width, uint32_t height, const uint8_t *rgba,
                      mn_status *st) {
    char temporary[4096], target[PATH_MAX];
    char error[128] = "no memory";
    struct stat info;
    if (stat(path, &info) == 0) { /* renaming would take a device's place, or a link's */
        if (!S_ISREG(info.st_mode))
            return mn_fail(st, MN_FAILED, "%s: not a regular file; name another picture", path);
        path = realpath(path, target);
    }
    if (path == NULL || snprintf(temporary, sizeof temporary, "%s.%ld.tmp", path, (long)getpid()) >=
                            (int)sizeof temporary)
        return mn_fail(st, MN_USAGE, "path of the picture is longer than 4,000 characters");
    errno = 0;
    FILE *file = fopen(temporary, "wbe");
    if (file == NULL)
        return failure(path, error, st);
    bool good = encode(file, width, height, rgba, error);
    good = good && fflush(file) == 0 && fsync(fileno(file)) == 0;
    mn_code code = good ? MN_OK : failure(path, error, st);
    errno = 0;
    if (fclose(file) != 0 && code == MN_OK)
        code = failure(path, error, st);
    if (code == MN_OK && rename(temporary, path) != 0)
        code = failure(path, error, st);
    if (code != MN_OK)
        unlink(temporary);
    return code;
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
