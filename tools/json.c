/* See json.h. Keys are ours and need no escaping; values do. */
#include "json.h"

#include <inttypes.h>
#include <math.h>

static void item(json *j, const char *key) {
    fprintf(j->out, "%s\n%*s", j->first ? "" : ",", 2 * j->depth, "");
    j->first = false;
    if (key != NULL)
        fprintf(j->out, "\"%s\": ", key);
}

void json_begin(json *j, FILE *out) {
    *j = (json){.out = out, .depth = 1, .first = true};
    fputc('{', out);
}

void json_u64(json *j, const char *key, uint64_t value) {
    item(j, key);
    fprintf(j->out, "%" PRIu64, value);
}

void json_f64(json *j, const char *key, double value) {
    item(j, key);
    if (isfinite(value))
        fprintf(j->out, "%.9g", value);
    else
        fputs("null", j->out);
}

/* Bytes of the character at c in UTF-8 (RFC 3629: shortest forms, no surrogates); 0: it is none. */
static int utf8_bytes(const unsigned char *c) {
    if (*c < 0x80)
        return 1;
    const int bytes = *c >= 0xc2 && *c < 0xe0   ? 2
                      : *c >= 0xe0 && *c < 0xf0 ? 3
                      : *c >= 0xf0 && *c < 0xf5 ? 4
                                                : 0;
    for (int i = 1; i < bytes; i++) /* ends at the NUL at the latest */
        if ((c[i] & 0xc0) != 0x80)
            return 0;
    const bool wrong = (*c == 0xe0 && c[1] < 0xa0) || (*c == 0xed && c[1] > 0x9f) ||
                       (*c == 0xf0 && c[1] < 0x90) || (*c == 0xf4 && c[1] > 0x8f);
    return wrong ? 0 : bytes;
}

/* Names of files may be any bytes: what is no UTF-8 becomes U+FFFD, for JSON must be UTF-8. */
void json_str(json *j, const char *key, const char *value) {
    item(j, key);
    fputc('"', j->out);
    const unsigned char *c = (const unsigned char *)value;
    while (*c != 0) {
        const int bytes = utf8_bytes(c);
        if (*c == '"' || *c == '\\')
            fprintf(j->out, "\\%c", *c);
        else if (*c < 0x20)
            fprintf(j->out, "\\u%04x", *c);
        else if (bytes == 0)
            fputs("\\ufffd", j->out);
        else
            fwrite(c, 1, (size_t)bytes, j->out);
        c += bytes > 0 ? bytes : 1;
    }
    fputc('"', j->out);
}

void json_bool(json *j, const char *key, bool value) {
    item(j, key);
    fputs(value ? "true" : "false", j->out);
}

void json_null(json *j, const char *key) {
    item(j, key);
    fputs("null", j->out);
}

void json_cap(json *j, const char *key, uint64_t bytes) {
    if (bytes > 0)
        json_u64(j, key, bytes);
    else
        json_null(j, key);
}

void json_open(json *j, const char *key, char bracket) {
    item(j, key);
    fputc(bracket, j->out);
    j->depth++;
    j->first = true;
}

void json_close(json *j, char bracket) {
    j->depth--;
    fprintf(j->out, "\n%*s%c", 2 * j->depth, "", bracket);
    j->first = false;
}

void json_end(json *j) {
    fputs("\n}\n", j->out);
}
