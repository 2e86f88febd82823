/* The folder of metanode tune: see tune.h. Hidden here: what makes results comparable, and the form
 * of results.csv.
 *
 *   tune.txt      what all results in the folder have in common; locked while somebody is at work
 *   tree.vdt      of a mesh; NAME.mnt: its layouts
 *   results.csv   a line a cell, in the order in which they were measured
 *
 * A line goes to the file in one write, and is only a line with its newline: a torn last one is cut
 * off. A later line of a cell stands for an earlier one. Lines of cells that are not asked for this
 * time stay. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <fnmatch.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "child.h"
#include "cli.h"
#include "host.h"
#include "tune.h"

enum { LINE_MAX_BYTES = 2048, STAMP_MAX = 4 * PATH_MAX, COLUMNS_OF_KEY = 5 };

static const char first_line[] = "metanode tune: results of these\n";

/* ---- names and hashes ------------------------------------------------------------------------ */

int tune_file_name(const tune *t, const char *name, char *path, size_t room) {
    const int length = snprintf(path, room, "%s/%s", t->o.folder, name);
    return length < 0 || (size_t)length >= room ? -1 : 0;
}

/* Of all bytes. */
static mn_code hash_file(const char *path, uint64_t *hash, uint64_t *bytes, mn_status *st) {
    enum { PIECE = 1 << 18 };
    struct stat info;
    if (stat(path, &info) == 0 && !S_ISREG(info.st_mode)) /* a fifo would be waited for */
        return mn_fail(st, MN_BAD_INPUT, "%s: not a file; give the name of a regular file", path);
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    char *piece = malloc(PIECE);
    XXH3_state_t *state = XXH3_createState();
    ssize_t got = -1;
    *bytes = 0;
    if (fd >= 0 && piece != NULL && state != NULL && XXH3_64bits_reset(state) == XXH_OK) {
        while ((got = read(fd, piece, PIECE)) > 0) {
            XXH3_64bits_update(state, piece, (size_t)got);
            *bytes += (uint64_t)got;
        }
        *hash = XXH3_64bits_digest(state);
    }
    if (got < 0)
        mn_fail(st, MN_BAD_INPUT, "%s: cannot be read: %s", path, strerror(errno));
    if (fd >= 0)
        close(fd);
    XXH3_freeState(state);
    free(piece);
    return got < 0 ? MN_BAD_INPUT : MN_OK;
}

static void find_machine(char *name, size_t room) {
    char line[256], model[128] = "processor unknown";
    FILE *f = fopen("/proc/cpuinfo", "re");
    while (f != NULL && fgets(line, sizeof line, f) != NULL)
        if (sscanf(line, "model name : %127[^\n]", model) == 1)
            break;
    if (f != NULL)
        fclose(f);
    snprintf(name, room, "%s, %u processors, %.1f GB", model, host_cpus(""),
             (double)host_ram_bytes("") / 1073741824);
}

static mn_code name_paths(tune *t, mn_status *st) {
    static const char *const standard[] = {"orbit", "dive", "flyover", NULL};
    for (uint32_t i = 0; i < t->o.paths; i++) {
        tune_path *p = &t->o.path[i];
        uint64_t hash = 0, bytes = 0;
        const int known = cli_choice(p->name, standard);
        if (known < 0 && access(p->name, F_OK) != 0)
            return mn_fail(st, MN_USAGE,
                           "--path %s: neither orbit, dive nor flyover, and no file: %s", p->name,
                           strerror(errno));
        if (known < 0 && hash_file(p->name, &hash, &bytes, st) != MN_OK)
            return MN_BAD_INPUT;
        if (known >= 0)
            snprintf(p->key, sizeof p->key, "%s", standard[known]);
        else
            snprintf(p->key, sizeof p->key, "%.40s@%016llx", p->label, (unsigned long long)hash);
    }
    return MN_OK;
}

/* ---- the stamp ------------------------------------------------------------------------------- */

static mn_code write_stamp(tune *t, char *text, size_t room, mn_status *st) {
    uint64_t hash = 0, bytes = 0;
    const tune_options *o = &t->o;
    mn_code code = hash_file("/proc/self/exe", &hash, &bytes, st);
    snprintf(t->program, sizeof t->program, "%s (%016llx)", METANODE_VERSION,
             (unsigned long long)hash);
    find_machine(t->machine, sizeof t->machine);
    if (code == MN_OK)
        code = hash_file(o->in, &hash, &bytes, st);
    const int length = snprintf(
        text, room,
        "%sprogram %s\nmachine %s\ninput %016llx, %llu bytes\nflown at %s frames a second, %s, "
        "tolerance %s, degrading %s, open %s\n",
        first_line, t->program, t->machine, (unsigned long long)hash, (unsigned long long)bytes,
        o->fps, o->size, o->tolerance, o->degrade, o->open);
    if (code == MN_OK && (length < 0 || (size_t)length >= room))
        code = mn_fail(st, MN_USAGE, "options too long");
    return code;
}

/* The first line in which two stamps differ, of either. */
static void differing(const char *a, const char *b, char *of_a, char *of_b, size_t room) {
    for (;;) {
        const size_t la = strcspn(a, "\n"), lb = strcspn(b, "\n");
        if (la != lb || memcmp(a, b, la) != 0 || a[la] == 0 || b[lb] == 0) {
            snprintf(of_a, room, "%.*s", (int)la, a);
            snprintf(of_b, room, "%.*s", (int)lb, b);
            return;
        }
        a += la + 1;
        b += lb + 1;
    }
}

/* Only what this command has made. */
static void clear(const tune *t) {
    static const char *const ours[] = {"results.csv", "tree.vdt", "packed-*.mnt", "levels-*.mnt"};
    DIR *list = opendir(t->o.folder);
    const struct dirent *entry;
    while (list != NULL && (entry = readdir(list)) != NULL)
        for (size_t i = 0; i < sizeof ours / sizeof ours[0]; i++)
            if (fnmatch(ours[i], entry->d_name, 0) == 0)
                unlinkat(dirfd(list), entry->d_name, 0);
    if (list != NULL)
        closedir(list);
}

static bool is_empty(const char *folder) {
    DIR *list = opendir(folder);
    const struct dirent *entry;
    bool empty = list != NULL;
    while (list != NULL && (entry = readdir(list)) != NULL)
        empty &= strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0;
    if (list != NULL)
        closedir(list);
    return empty;
}

/* What stands in tune.txt already must be what would be written. */
static mn_code agree(tune *t, const char *stamp, mn_status *st) {
    char found[STAMP_MAX], there[300], here[300];
    const ssize_t got = pread(t->stamp_fd, found, sizeof found - 1, 0);
    found[got > 0 ? got : 0] = 0;
    if (got != 0 && strncmp(found, first_line, strlen(first_line)) != 0)
        return mn_fail(st, MN_USAGE, "%s/tune.txt is not of tune; name another folder",
                       t->o.folder);
    if (strcmp(found, stamp) == 0 && !t->o.fresh)
        return MN_OK;
    differing(found, stamp, there, here, sizeof there);
    if (got != 0 && !t->o.fresh)
        return mn_fail(st, MN_USAGE,
                       "%s holds results of '%s', and this is '%s'; name another folder, or give "
                       "--fresh",
                       t->o.folder, there, here);
    clear(t);
    if (ftruncate(t->stamp_fd, 0) != 0 ||
        pwrite(t->stamp_fd, stamp, strlen(stamp), 0) != (ssize_t)strlen(stamp))
        return mn_fail(st, mn_code_of_write(errno), "%s/tune.txt: cannot be written: %s; %s",
                       t->o.folder, strerror(errno), cli_write_advice(errno));
    return MN_OK;
}

mn_code tune_folder_open(tune *t, mn_status *st) {
    char stamp[STAMP_MAX], path[PATH_MAX];
    const char *folder = t->o.folder;
    t->stamp_fd = t->results_fd = -1;
    mn_code code = name_paths(t, st);
    if (code == MN_OK)
        code = write_stamp(t, stamp, sizeof stamp, st);
    if (code != MN_OK)
        return code;
    t->is_new = mkdir(folder, 0777) == 0;
    if (!t->is_new && errno != EEXIST)
        return mn_fail(st, mn_code_of_write(errno),
                       "%s: cannot be made: %s; name a directory in one that is there, and can be "
                       "written",
                       folder, strerror(errno));
    if (tune_file_name(t, "tune.txt", path, sizeof path) < 0)
        return mn_fail(st, MN_USAGE, "%.80s…: too long a name", folder);
    if (access(path, F_OK) != 0 && !is_empty(folder))
        return mn_fail(st, MN_USAGE,
                       "%s is not an empty folder, nor one of tune; name another, or make it",
                       folder);
    t->stamp_fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (t->stamp_fd < 0)
        return mn_fail(st, MN_FAILED, "%s: cannot be written: %s", path, strerror(errno));
    if (flock(t->stamp_fd, LOCK_EX | LOCK_NB) != 0)
        return mn_fail(st, MN_FAILED, "%s: another tune is at work there", folder);
    code = agree(t, stamp, st);
    if (code != MN_OK)
        return code;
    if (tune_file_name(t, "results.csv", path, sizeof path) < 0)
        return mn_fail(st, MN_USAGE, "%.80s…: too long a name", folder);
    t->results_fd = open(path, O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    return t->results_fd >= 0
               ? MN_OK
               : mn_fail(st, MN_FAILED, "%s: cannot be written: %s", path, strerror(errno));
}

void tune_folder_forget(tune *t) {
    char path[PATH_MAX];
    struct stat info;
    if (fstat(t->results_fd, &info) != 0 || info.st_size > 0)
        return;
    clear(t);
    if (tune_file_name(t, "tune.txt", path, sizeof path) >= 0)
        unlink(path);
    if (t->is_new)
        (void)rmdir(t->o.folder);
    t->is_forgotten = true;
}

void tune_folder_close(tune *t) {
    if (t->results_fd >= 0)
        close(t->results_fd);
    if (t->stamp_fd >= 0)
        close(t->stamp_fd);
}

/* ---- a line ---------------------------------------------------------------------------------- */

/* Adds to a text; *length passes room when it does not fit. */
__attribute__((format(printf, 4, 5))) static void add(char *text, size_t room, size_t *length,
                                                      const char *format, ...) {
    va_list args;
    if (*length >= room)
        return;
    va_start(args, format);
    const int more = vsnprintf(text + *length, room - *length, format, args);
    va_end(args);
    *length = more < 0 ? room : *length + (size_t)more;
}

void tune_cell_key(const tune *t, const tune_cell *c, char *key, size_t room) {
    char places[32];
    snprintf(places, sizeof places, "%s",
             c->resident                                 ? "all"
             : t->o.places[c->places].kind == TUNE_LEAST ? "min"
                                                         : "cap");
    if (c->k > 0)
        snprintf(places, sizeof places, "%u", c->k);
    const tune_path *path = &t->o.path[c->path];
    snprintf(key, room, "%s,%llu,%s,%s:%u,%s,", t->layout[c->layout].name,
             (unsigned long long)(c->resident ? 0 : t->o.cap[c->cap]), places, path->key,
             path->frames, c->resident ? "resident" : tune_prefetch_name(c->prefetch));
}

bool tune_line_write(const tune *t, const tune_cell *c, char *line, size_t room) {
    char says[sizeof c->says];
    size_t length = 0;
    tune_cell_key(t, c, line, room);
    length = strlen(line);
    snprintf(says, sizeof says, "%s", c->says);
    for (char *at = says; *at != 0; at++) /* a line is a line, a field a field */
        if (*at == '"' || *at == '\n')
            *at = '\'';
    add(line, room, &length, "%d,\"%s\"", c->code, says);
    for (int i = 0; i < TUNE_FIGURES; i++) {
        add(line, room, &length, ",");
        if (!isnan(c->figure[i]))
            add(line, room, &length, isinf(c->figure[i]) ? "inf" : "%.9g", c->figure[i]);
    }
    add(line, room, &length, "\n");
    return length < room;
}

/* Where the key ends; NULL: no key. Names of path files may hold anything but commas. */
static const char *after_key(const char *line) {
    for (int i = 0; i < COLUMNS_OF_KEY && line != NULL; i++) {
        line = strchr(line, ',');
        line = line != NULL ? line + 1 : NULL;
    }
    return line;
}

bool tune_line_read(const char *line, tune_cell *c) {
    char *end = NULL;
    const char *at = after_key(line);
    if (at == NULL)
        return false;
    const long code = strtol(at, &end, 10);
    if (end == at || code < 0 || code > 255 || strncmp(end, ",\"", 2) != 0)
        return false;
    const char *says = end + 2, *quote = strchr(says, '"');
    if (quote == NULL || (size_t)(quote - says) >= sizeof c->says)
        return false;
    c->code = (int)code;
    c->state = code == 0 ? TUNE_MEASURED : TUNE_REFUSED;
    snprintf(c->says, sizeof c->says, "%.*s", (int)(quote - says), says);
    at = quote + 1;
    for (int i = 0; i < TUNE_FIGURES; i++) {
        if (*at != ',')
            return false;
        at++;
        c->figure[i] = NAN;
        if (*at == ',' || *at == '\n')
            continue;
        c->figure[i] = strtod(at, &end);
        if (end == at || !(c->figure[i] >= 0))
            return false;
        at = end;
    }
    return *at == '\n' && at[1] == 0;
}

/* ---- results.csv ----------------------------------------------------------------------------- */

static void header_line(char *line, size_t room) {
    size_t length = 0;
    add(line, room, &length, "layout,cap_bytes,k_asked,path,prefetch,code,says");
    for (int i = 0; i < TUNE_FIGURES; i++)
        add(line, room, &length, ",%s", tune_figure_names[i]);
    add(line, room, &length, "\n");
}

static mn_code append(tune *t, const char *line, mn_status *st) {
    const size_t length = strlen(line);
    errno = 0;
    if (write(t->results_fd, line, length) == (ssize_t)length && fdatasync(t->results_fd) == 0)
        return MN_OK;
    const int error = errno != 0 ? errno : ENOSPC; /* a part was written */
    return mn_fail(st, mn_code_of_write(error), "%s/results.csv: cannot be written whole: %s; %s",
                   t->o.folder, strerror(error), cli_write_advice(error));
}

/* What did not fit memory would not now, nor be done in less time; what else has failed is tried
 * again. */
static bool stands(const tune *t, const tune_cell *read) {
    return read->code == MN_OK || read->code == MN_CAP_TOO_SMALL ||
           (read->code == CHILD_LATE && read->figure[TUNE_SECONDS] >= (double)t->o.limit_s);
}

/* The cell that a line is of. */
static void take_line(tune *t, const char *line, const tune_cell *read) {
    char key[TUNE_NAME_MAX * 4];
    if (!stands(t, read))
        return;
    for (size_t i = 0; i < t->cells; i++) {
        tune_cell *c = &t->cell[i];
        tune_cell_key(t, c, key, sizeof key);
        if (strncmp(line, key, strlen(key)) != 0)
            continue;
        c->state = read->state;
        c->code = read->code;
        memcpy(c->says, read->says, sizeof c->says);
        memcpy(c->figure, read->figure, sizeof c->figure);
    }
}

static mn_code load_lines(tune *t, FILE *f, off_t *whole, mn_status *st) {
    char line[LINE_MAX_BYTES + 1], header[LINE_MAX_BYTES];
    header_line(header, sizeof header);
    *whole = 0;
    for (uint64_t number = 1; fgets(line, sizeof line, f) != NULL; number++) {
        tune_cell read;
        const size_t length = strlen(line);
        if (length > 0 && line[length - 1] != '\n' && feof(f))
            return MN_OK; /* torn */
        if (number == 1 ? strcmp(line, header) != 0 : !tune_line_read(line, &read))
            return mn_fail(st, MN_BAD_INPUT,
                           "%s/results.csv: line %llu is none of tune's; take it out, or give "
                           "--fresh",
                           t->o.folder, (unsigned long long)number);
        if (number > 1)
            take_line(t, line, &read);
        *whole += (off_t)length;
    }
    return MN_OK;
}

mn_code tune_results_load(tune *t, mn_status *st) {
    char header[LINE_MAX_BYTES];
    off_t whole = 0;
    const int fd = dup(t->results_fd);
    FILE *f = fd >= 0 ? fdopen(fd, "r") : NULL;
    if (f == NULL)
        return mn_fail(st, MN_FAILED, "%s/results.csv: %s", t->o.folder, strerror(errno));
    rewind(f);
    mn_code code = load_lines(t, f, &whole, st);
    fclose(f);
    if (code == MN_OK && ftruncate(t->results_fd, whole) != 0)
        code = mn_fail(st, MN_FAILED, "%s/results.csv: %s", t->o.folder, strerror(errno));
    header_line(header, sizeof header);
    return code == MN_OK && whole == 0 ? append(t, header, st) : code;
}

mn_code tune_results_add(tune *t, const tune_cell *cell, mn_status *st) {
    char line[LINE_MAX_BYTES];
    if (!tune_line_write(t, cell, line, sizeof line))
        return mn_fail(st, MN_FAILED, "%s/results.csv: a line is too long", t->o.folder);
    return append(t, line, st);
}
