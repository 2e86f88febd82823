/* One JSON object on standard output: snake_case keys, plain numbers. Main thread only. */
#ifndef METANODE_JSON_H
#define METANODE_JSON_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef struct json {
    FILE *out;
    int depth;
    bool first;
} json;

void json_begin(json *j, FILE *out);
void json_u64(json *j, const char *key, uint64_t value);
void json_f64(json *j, const char *key, double value); /* NaN and infinities become null */
void json_str(json *j, const char *key, const char *value);
void json_bool(json *j, const char *key, bool value);
void json_null(json *j, const char *key);
void json_cap(json *j, const char *key, uint64_t bytes); /* 0: no cap, which is null */
void json_open(json *j, const char *key, char bracket);  /* '{' or '['; key NULL inside an array */
void json_close(json *j, char bracket);                  /* '}' or ']' */
void json_end(json *j);                                  /* closes the object, newline */

#endif
