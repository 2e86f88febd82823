/* The tree that metanode tune cuts, and its layouts: see tune.h. Hidden here: that the program
 * calls itself, and that two layouts are made at a time, each by one thread; nothing is measured
 * yet. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "child.h"
#include "cli.h"
#include "host.h"
#include "metanode/build.h"
#include "tune.h"

enum { AT_ONCE = 2, WORDS_MAX = 24 };

/* ---- the tree -------------------------------------------------------------------------------- */

/* A whole one or not: its first bytes say so. */
static bool is_mnt(const char *path) {
    static const char magic[] = "MNTREE";
    char bytes[sizeof magic - 1] = {0};
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    const ssize_t got = fd >= 0 ? read(fd, bytes, sizeof bytes) : -1;
    if (fd >= 0)
        close(fd);
    return got == (ssize_t)sizeof bytes && memcmp(bytes, magic, sizeof bytes) == 0;
}

static mn_code find_tree(const char *path, bool *is_tree, mn_status *st) {
    mn_header header;
    *is_tree = mn_tree_is_vdt(path) || is_mnt(path);
    return is_mnt(path) ? mn_header_read(path, &header, st) : MN_OK;
}

/* What simplify and block advise, by the names that it has here. */
static void say_as_tune(char *says, size_t room) {
    static const char *const words[][2] = {
        {"--ram ", "--build-ram "},
        {"a lower -L", "a lower of --levels"},
        {"lower -L", "lower --levels"},
        {"another folder with --temp-dir", "another folder with -o"},
        {"another --temp-dir", "another -o"},
        {" --resume", " the same command"}};
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        char text[400];
        const char *at = strstr(says, words[i][0]);
        if (at == NULL)
            continue;
        snprintf(text, sizeof text, "%.*s%s%s", (int)(at - says), says, words[i][1],
                 at + strlen(words[i][0]));
        snprintf(says, room, "%.*s", (int)room - 1, text);
    }
}

static bool exists(const char *path) {
    struct stat about;
    return stat(path, &about) == 0;
}

/* Simplifies the mesh, goes on where that was killed. Its progress on a terminal is told by itself.
 */
static mn_code make_tree(tune *t, mn_status *st) {
    char ram[32], jobs[32], work[PATH_MAX + 8];
    const char *words[WORDS_MAX] = {NULL, "metanode", "simplify", t->o.in, "-o", t->tree};
    int n = 6, which;
    child run;
    child_end end = {0};
    snprintf(work, sizeof work, "%s.work", t->tree);
    snprintf(ram, sizeof ram, "%llu", (unsigned long long)t->o.build_ram_bytes);
    snprintf(jobs, sizeof jobs, "%llu", (unsigned long long)t->o.jobs);
    if (t->o.build_ram_bytes > 0) {
        words[n++] = "--ram";
        words[n++] = ram;
    }
    if (t->o.jobs > 0) {
        words[n++] = "-j";
        words[n++] = jobs;
    }
    if (exists(work) && !t->o.fresh)
        words[n++] = "--resume";
    setenv(CLI_ERRORS_APART, "1", true);
    mn_code code = child_start(&run, words, false, st);
    unsetenv(CLI_ERRORS_APART);
    if (code == MN_OK)
        code = child_wait(&run, 1, &which, &end, st);
    say_as_tune(end.says, sizeof end.says);
    if (code == MN_OK && cli_interrupted() != 0)
        code = mn_fail(st, MN_FAILED, "interrupted");
    else if (code == MN_OK && end.code > MN_OK && end.code <= MN_NO_GRAPHICS)
        code = mn_fail(st, (mn_code)end.code, "%s", end.says);
    else if (code == MN_OK && end.code != 0) /* it was killed */
        code = mn_fail(st, MN_FAILED, "%s: its tree could not be made (%s)", t->o.in, end.says);
    child_end_free(&end);
    return code;
}

/* ---- layouts --------------------------------------------------------------------------------- */

static void add_layout(tune *t, mn_blocking blocking, uint32_t size) {
    tune_layout *l = &t->layout[t->layouts++];
    *l = (tune_layout){.blocking = blocking, .size = size};
    if (blocking == MN_BLOCKING_LEVELS)
        snprintf(l->name, sizeof l->name, "levels-%u", size);
    else
        snprintf(l->name, sizeof l->name, "packed-%uK", size >> 10);
}

static mn_code name_layouts(tune *t, mn_status *st) {
    char file[TUNE_NAME_MAX + 8];
    const tune_options *o = &t->o;
    for (uint32_t i = 0; i < o->policies; i++) {
        for (uint32_t j = 0; o->policy[i] == MN_BLOCKING_LEVELS && j < o->levels_count; j++)
            add_layout(t, MN_BLOCKING_LEVELS, o->levels[j]);
        for (uint32_t j = 0; o->policy[i] == MN_BLOCKING_PACKED && j < o->block_bytes_count; j++)
            add_layout(t, MN_BLOCKING_PACKED, o->block_bytes[j]);
    }
    for (uint32_t i = 0; i < t->layouts; i++) {
        snprintf(file, sizeof file, "%s.mnt", t->layout[i].name);
        if (tune_file_name(t, file, t->layout[i].file, sizeof t->layout[i].file) < 0)
            return mn_fail(st, MN_USAGE, "%.80s…: too long a name", o->folder);
    }
    return MN_OK;
}

/* Before anything is measured: is there a layout that could be flown under one of the caps? What
 * the first lacks is said. */
mn_code tune_caps_will_do(const tune *t, mn_status *st) {
    mn_status first = {0};
    for (uint32_t i = 0; i < t->layouts; i++)
        for (uint32_t cap = 0; cap < t->o.caps && t->layout[i].code == MN_OK; cap++) {
            mn_status own = {0};
            mn_session *session = NULL;
            const mn_session_desc desc = {.path = t->layout[i].file,
                                          .ram_bytes = t->o.cap[cap],
                                          .k = MN_K_MIN,
                                          .io = MN_IO_PREAD};
            if (t->o.cap[cap] > 0)
                (void)mn_session_open(&desc, &session, &own);
            mn_session_close(session);
            if (own.code != MN_CAP_TOO_SMALL)
                return MN_OK;
            if (first.code == MN_OK)
                first = own;
        }
    if (first.code == MN_OK)
        return MN_OK;
    tune_name_cap(t, first.text, sizeof first.text);
    return mn_fail(st, first.code, "tune: no setting could be measured: %s", first.text);
}

static mn_code start_layout(const tune *t, const tune_layout *l, child *run, mn_status *st) {
    const bool levels = l->blocking == MN_BLOCKING_LEVELS;
    char size[32], ram[32];
    const char *words[WORDS_MAX] = {NULL,
                                    "metanode",
                                    "block",
                                    t->tree,
                                    "-o",
                                    l->file,
                                    "-j",
                                    "1",
                                    "--blocking",
                                    levels ? "levels" : "packed",
                                    levels ? "-L" : "--block-bytes",
                                    size};
    int n = 12;
    snprintf(size, sizeof size, "%u", l->size);
    snprintf(ram, sizeof ram, "%llu", (unsigned long long)t->o.build_ram_bytes);
    if (t->o.build_ram_bytes > 0) {
        words[n++] = "--ram";
        words[n++] = ram;
    }
    return child_start(run, words, true, st);
}

/* What a layout that was made, or found, is. One that cannot be read is made again. */
static void look_at(tune_layout *l, const child_end *end) {
    mn_status st = {0};
    if (end->code != 0) {
        l->code = end->code <= MN_NO_GRAPHICS ? (mn_code)end->code : MN_FAILED;
        snprintf(l->says, sizeof l->says, "%.199s", end->says);
        say_as_tune(l->says, sizeof l->says);
    } else if (mn_header_read(l->file, &l->header, &st) != MN_OK) {
        l->code = st.code;
        snprintf(l->says, sizeof l->says, "%.199s", st.text);
    }
}

/* Two at a time. A layout that cannot be made is told in the table; the others are measured. */
static mn_code make_layouts(tune *t, mn_status *st) {
    child run[AT_ONCE] = {{0}};
    uint32_t of[AT_ONCE] = {0}, next = 0;
    uint64_t at_once = t->o.jobs != 0 ? t->o.jobs : host_cpus("");
    int running = 0;
    mn_code code = MN_OK;
    cli_meter meter = {0};
    at_once = at_once > AT_ONCE ? AT_ONCE : at_once;
    while (running > 0 || (next < t->layouts && code == MN_OK)) {
        for (int i = 0; i < (int)at_once && next < t->layouts && code == MN_OK; i++) {
            if (run[i].pid > 0)
                continue;
            tune_layout *l = &t->layout[next];
            if (mn_header_read(l->file, &l->header, NULL) != MN_OK) {
                of[i] = next;
                code = start_layout(t, l, &run[i], st);
                running += code == MN_OK;
            }
            next++;
        }
        if (running == 0)
            continue;
        int which;
        child_end end;
        cli_progress(&meter, "cutting", next - (uint32_t)running, t->layouts);
        mn_code waited = child_wait(run, AT_ONCE, &which, &end, st);
        if (waited != MN_OK)
            return waited;
        running--;
        look_at(&t->layout[of[which]], &end);
        child_end_free(&end);
        if (cli_interrupted() != 0)
            code = mn_fail(st, MN_FAILED, "interrupted");
    }
    cli_progress_end(&meter);
    return code;
}

/* Frames of path files, which only now can be opened, and the measure of shares. */
static mn_code know_layouts(tune *t, mn_status *st) {
    const tune_layout *any = NULL;
    for (uint32_t i = 0; i < t->layouts; i++) {
        const tune_layout *l = &t->layout[i];
        if (l->code != MN_OK)
            continue;
        const uint64_t bytes = (uint64_t)l->header.blocks * l->header.block_bytes_max;
        any = l;
        if (t->smallest_bytes != 0 && bytes >= t->smallest_bytes)
            continue;
        t->smallest_bytes = bytes;
        t->smallest = i;
    }
    if (any == NULL)
        return mn_fail(st, t->layout[0].code, "no layout could be made: %s", t->layout[0].says);
    for (uint32_t i = 0; i < t->o.paths; i++) {
        mn_path *path = NULL;
        mn_code code = mn_path_open(t->o.path[i].name, &any->header, 45, &path, st);
        if (code != MN_OK)
            return code;
        const uint32_t recorded = mn_path_frames(path);
        t->o.path[i].frames = recorded > 0 && !t->o.frames_given ? recorded : t->o.frames;
        mn_path_close(path);
    }
    return MN_OK;
}

mn_code tune_build(tune *t, mn_status *st) {
    bool given = false;
    mn_code code = find_tree(t->o.in, &given, st);
    if (code == MN_OK)
        code = name_layouts(t, st);
    if (given)
        snprintf(t->tree, sizeof t->tree, "%s", t->o.in);
    else if (code == MN_OK && tune_file_name(t, "tree.vdt", t->tree, sizeof t->tree) < 0)
        code = mn_fail(st, MN_USAGE, "%.80s…: too long a name", t->o.folder);
    if (code == MN_OK && !given && !mn_tree_is_vdt(t->tree))
        code = make_tree(t, st);
    if (code == MN_OK)
        code = make_layouts(t, st);
    return code == MN_OK ? know_layouts(t, st) : code;
}
