/* See host.h. Hidden here: where the kernel's two kinds of cgroups say their limits.
 *
 * /proc/self/cgroup names our group in each hierarchy, /proc/self/mountinfo where that is mounted
 * and from which group on. Each group on the way up may have a limit, and the least one counts:
 *
 *     5:memory:/a/b        … /a /sys/fs/cgroup/memory … - cgroup cgroup rw,memory
 *         our group ──► /sys/fs/cgroup/memory/b, then /sys/fs/cgroup/memory
 *
 * Version 2 has one hierarchy of the type cgroup2, whose line begins with "0::". What cannot be
 * read is no limit. Memory: the stack. */
#define _GNU_SOURCE /* sched_getaffinity */
#include "host.h"

#include <limits.h>
#include <math.h>
#include <sched.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/sysinfo.h>

enum { LINE_BYTES = PATH_MAX };

/* Limit of a group's folder; INFINITY: it has none. */
typedef double (*limit_of)(const char *folder);

static double number_in(const char *folder, const char *file, int index) {
    char path[LINE_BYTES + 64];
    double first = NAN, second = NAN; /* "max" is none */
    snprintf(path, sizeof path, "%s/%s", folder, file);
    FILE *f = fopen(path, "re");
    if (f == NULL)
        return NAN;
    if (fscanf(f, "%lf", &first) != 1 && fscanf(f, "%*s") == EOF)
        first = NAN;
    if (fscanf(f, "%lf", &second) != 1)
        second = NAN;
    fclose(f);
    return index == 0 ? first : second;
}

static double or_none(double limit) {
    return limit >= 0 ? limit : INFINITY; /* NAN; -1 is version 1's word for it */
}

static double memory_limit(const char *folder) {
    double limit = or_none(number_in(folder, "memory.max", 0));
    limit = fmin(limit, or_none(number_in(folder, "memory.high", 0)));
    return fmin(limit, or_none(number_in(folder, "memory.limit_in_bytes", 0)));
}

static double cpu_limit(const char *folder) {
    double limit = or_none(number_in(folder, "cpu.max", 0) / number_in(folder, "cpu.max", 1));
    return fmin(limit, or_none(number_in(folder, "cpu.cfs_quota_us", 0) /
                               number_in(folder, "cpu.cfs_period_us", 0)));
}

/* One of the words between commas. */
static bool has_word(const char *list, const char *word) {
    const size_t length = strlen(word);
    for (const char *at = list; (at = strstr(at, word)) != NULL; at += length)
        if ((at == list || at[-1] == ',') && strchr(",\n", at[length]) != NULL)
            return true;
    return false;
}

/* Our group in the hierarchy of the controller; version 2 has no list of controllers there. */
static bool group_of(const char *root, const char *controller, bool version_2, char *group) {
    char path[LINE_BYTES], line[LINE_BYTES], list[LINE_BYTES];
    bool found = false;
    snprintf(path, sizeof path, "%s/proc/self/cgroup", root);
    FILE *f = fopen(path, "re");
    if (f == NULL)
        return false;
    while (!found && fgets(line, sizeof line, f) != NULL) {
        if (version_2)
            found = sscanf(line, "0::%[^\n]", group) == 1;
        else
            found =
                sscanf(line, "%*d:%[^:]:%[^\n]", list, group) == 2 && has_word(list, controller);
    }
    fclose(f);
    return found;
}

/* The least limit from our group up to where the hierarchy is mounted. */
static double least_up(char *folder, size_t mount_length, limit_of limit) {
    double least = INFINITY;
    for (;;) {
        least = fmin(least, limit(folder));
        char *slash = strrchr(folder, '/');
        if (slash == NULL || slash < folder + mount_length)
            return least;
        *slash = 0;
    }
}

/* A line of mountinfo: what it says of the controller's groups. */
static double mount_limit(const char *root, const char *line, const char *controller,
                          limit_of limit) {
    char from[LINE_BYTES], at[LINE_BYTES], group[LINE_BYTES], folder[3 * LINE_BYTES];
    const char *type = strstr(line, " - ");
    const char *options = strrchr(line, ' ');
    if (type == NULL || sscanf(line, "%*d %*d %*s %s %s", from, at) != 2)
        return INFINITY;
    const bool version_2 = strncmp(type, " - cgroup2 ", 11) == 0;
    if (!version_2 && (strncmp(type, " - cgroup ", 10) != 0 || !has_word(options + 1, controller)))
        return INFINITY;
    if (!group_of(root, controller, version_2, group))
        return INFINITY;
    const size_t shown =
        strcmp(from, "/") == 0 ? 0 : strlen(from); /* the mount shows this and below */
    const bool below = strncmp(group, from, shown) == 0 && strstr(group, "/..") == NULL;
    int mount_length = snprintf(folder, sizeof folder, "%s%s", root, at);
    snprintf(folder + mount_length, sizeof folder - (size_t)mount_length, "%s",
             below && strcmp(group + shown, "/") != 0 ? group + shown : "");
    return least_up(folder, (size_t)mount_length, limit);
}

static double cgroup_limit(const char *root, const char *controller, limit_of limit) {
    char path[LINE_BYTES], line[LINE_BYTES];
    double least = INFINITY;
    snprintf(path, sizeof path, "%s/proc/self/mountinfo", root);
    FILE *f = fopen(path, "re");
    while (f != NULL && fgets(line, sizeof line, f) != NULL)
        least = fmin(least, mount_limit(root, line, controller, limit));
    if (f != NULL)
        fclose(f);
    return least;
}

uint64_t host_ram_bytes(const char *root) {
    struct sysinfo info;
    const uint64_t all = sysinfo(&info) == 0 ? (uint64_t)info.totalram * info.mem_unit : 1u << 30;
    const double limit = cgroup_limit(root, "memory", memory_limit);
    return limit < (double)all ? (uint64_t)limit : all;
}

uint64_t host_default_ram_bytes(void) {
    return host_ram_bytes("") / 2;
}

uint32_t host_cpus(const char *root) {
    cpu_set_t set;
    const int allowed = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    const double limit = fmax(1, ceil(cgroup_limit(root, "cpu", cpu_limit)));
    return limit < allowed ? (uint32_t)limit : (uint32_t)allowed;
}
