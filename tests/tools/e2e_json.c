/* e2e_json [--foreign] [KEY …] < TEXT: is the text one JSON object, as the program's --json
 * promises? Prints the values of the keys, one a line, as they are written (strings without their
 * quotes).
 *
 * Exit 0; 1 and a line that says what is wrong: not JSON (RFC 8259), more than one value, a key
 * twice, a key that is not snake_case, a number that a shell or awk would not take, or a KEY that
 * is not in the outermost object. --foreign: a format of others, whose keys need not be snake_case.
 * For the end-to-end scripts. One thread; memory: the text. */
#include <ctype.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TEXT_MAX = 1 << 24, KEYS_MAX = 256, DEPTH_MAX = 16 };

typedef struct member {
    const char *key, *value;
    int key_length, value_length;
} member;

static char text[TEXT_MAX + 8]; /* a word may be looked for at its end */
static member outer[KEYS_MAX];
static int members;
static bool foreign;

static void wrong(const char *at, const char *what) {
    fprintf(stderr, "e2e_json: byte %td: %s: %.20s\n", at - text, what, at);
    exit(1);
}

/* As strspn, which under a sanitizer reads all of the text each time. */
static const char *past(const char *at, const char *set) {
    while (*at != 0 && strchr(set, *at) != NULL)
        at++;
    return at;
}

static const char *space(const char *at) {
    return past(at, " \t\r\n");
}

static const char *string(const char *at) {
    if (*at++ != '"')
        wrong(at - 1, "a string should begin here");
    for (; *at != '"'; at++) {
        if ((unsigned char)*at < 0x20)
            wrong(at, "a control character, or the end, inside a string");
        if (*at == '\\' && strchr("\"\\/bfnrtu", *++at) == NULL)
            wrong(at, "an escape that JSON has not");
    }
    return at + 1;
}

static const char *number(const char *at) {
    const char *from = at;
    at += *at == '-';
    if (!isdigit((unsigned char)*at) || (*at == '0' && isdigit((unsigned char)at[1])))
        wrong(from, "neither a value nor a number");
    at = past(at, "0123456789");
    if (*at == '.') {
        if (!isdigit((unsigned char)*++at))
            wrong(from, "no digit after the point");
        at = past(at, "0123456789");
    }
    if (*at == 'e' || *at == 'E') {
        at += 1 + (at[1] == '+' || at[1] == '-');
        if (!isdigit((unsigned char)*at))
            wrong(from, "no digit in the exponent");
        at = past(at, "0123456789");
    }
    return at;
}

static const char *value(const char *at, int depth);

static void remember(const char *key, const char *key_end, const char *from, const char *to) {
    member m = {key, from, (int)(key_end - key), (int)(to - from)};
    for (int i = 0; i < members; i++)
        if (outer[i].key_length == m.key_length &&
            memcmp(outer[i].key, key, (size_t)m.key_length) == 0)
            wrong(key, "a key that has been there");
    if (members == KEYS_MAX)
        wrong(key, "too many keys");
    outer[members++] = m;
}

static const char *object(const char *at, int depth) {
    for (at = space(at + 1); *at != '}';) {
        const char *key = at + 1, *end = string(at) - 1;
        if (key == end || (!foreign && past(key, "abcdefghijklmnopqrstuvwxyz0123456789_") != end))
            wrong(key, "a key that is not snake_case");
        at = space(end + 1);
        if (*at != ':')
            wrong(at, "':' is missing");
        const char *from = space(at + 1), *to = value(from, depth + 1);
        if (depth == 0)
            remember(key, end, from, to);
        at = space(to);
        if (*at == ',' && *(at = space(at + 1)) != '}')
            continue;
        if (*at != '}')
            wrong(at, "',' or '}' is missing");
    }
    return at + 1;
}

static const char *array(const char *at, int depth) {
    for (at = space(at + 1); *at != ']';) {
        at = space(value(at, depth + 1));
        if (*at == ',' && *(at = space(at + 1)) != ']')
            continue;
        if (*at != ']')
            wrong(at, "',' or ']' is missing");
    }
    return at + 1;
}

static const char *value(const char *at, int depth) {
    static const char *const words[] = {"true", "false", "null"};
    if (depth > DEPTH_MAX)
        wrong(at, "too deep");
    if (*at == '{')
        return object(at, depth);
    if (*at == '[')
        return array(at, depth);
    if (*at == '"')
        return string(at);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (memcmp(at, words[i], strlen(words[i])) == 0) /* text is longer than it is read */
            return at + strlen(words[i]);
    return number(at);
}

static int print(const char *key) {
    for (int i = 0; i < members; i++) {
        const member *m = &outer[i];
        if (strlen(key) != (size_t)m->key_length || memcmp(key, m->key, strlen(key)) != 0)
            continue;
        int quoted = m->value[0] == '"';
        printf("%.*s\n", m->value_length - 2 * quoted, m->value + quoted);
        return 0;
    }
    fprintf(stderr, "e2e_json: no key '%s'\n", key);
    return 1;
}

int main(int argc, char **argv) {
    foreign = argc > 1 && strcmp(argv[1], "--foreign") == 0;
    size_t length = fread(text, 1, TEXT_MAX, stdin);
    if (strlen(text) != length || length == TEXT_MAX)
        wrong(text, "a zero byte, or too long");
    const char *at = space(text);
    if (*at != '{')
        wrong(at, "no object");
    at = space(value(at, 0));
    if (*at != 0)
        wrong(at, "more than one value");
    int missing = 0;
    for (int i = 1 + foreign; i < argc; i++)
        missing |= print(argv[i]);
    return missing;
}
