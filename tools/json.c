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

void json_str(json *j, const char *key, const char *value) {
    item(j, key);
    fputc('"', j->out);
    for (const unsigned char *c = (const unsigned char *)value; *c != 0; c++) {
        if (*c == '"' || *c == '\\')
            fprintf(j->out, "\\%c", *c);
        else if (*c < 0x20)
            fprintf(j->out, "\\u%04x", *c);
        else
            fputc(*c, j->out);
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
