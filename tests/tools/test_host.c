/* Goal: the least limit on the way from our cgroup up to the mount counts, in both versions of
 * cgroups, seen from inside a container and from outside; what cannot be read is no limit.
 * Method: folders with the kernel's files in them, and the machine's own figures. */
#define _GNU_SOURCE /* CPU_SET */
#include <check.h>
#include <sched.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "host.h"
#include "suite.h"

static char root[] = "/tmp/mn-host-XXXXXX";
static const char v1[] = "22 27 0:21 / /proc rw - proc proc rw\n"
                         "32 31 0:30 / /cg/cpu,cpuacct rw,relatime - cgroup cgroup rw,cpu,cpuacct\n"
                         "35 31 0:32 / /cg/memory rw,relatime - cgroup cgroup rw,memory\n"
                         "36 31 0:33 / /cg/cpuset rw,relatime - cgroup cgroup rw,cpuset\n";
static const char v1_groups[] = "9:name=systemd:/a\n4:memory:/a/b\n3:cpuset:/a\n"
                                "1:cpu,cpuacct:/a\n0::/\n";
static const char v2[] = "35 31 0:32 / /cg rw,relatime shared:4 - cgroup2 cgroup2 rw,nsdelegate\n";

static bool clear(void) {
    char command[80];
    snprintf(command, sizeof command, "rm -rf %s/*", root);
    return system(command) == 0;
}

static void setup(void) {
    ck_assert(clear());
}

static void put(const char *name, const char *text) {
    char path[200];
    snprintf(path, sizeof path, "%s/%s", root, name);
    for (char *at = path + strlen(root) + 1; (at = strchr(at, '/')) != NULL; *at++ = '/') {
        *at = 0;
        mkdir(path, 0700);
    }
    FILE *f = fopen(path, "w");
    ck_assert_msg(f != NULL, "%s", path);
    fputs(text, f);
    fclose(f);
}

static void machine(const char *mounts, const char *groups) {
    put("proc/self/mountinfo", mounts);
    put("proc/self/cgroup", groups);
}

START_TEST(no_limits) {
    const uint64_t ram = host_ram_bytes("/nowhere");
    const uint32_t cpus = host_cpus("/nowhere");
    ck_assert_uint_ge(ram, 1 << 20);
    ck_assert_uint_ge(cpus, 1);
    ck_assert_uint_le(host_ram_bytes(""), ram); /* whatever cgroups these tests are in */
    ck_assert_uint_le(host_cpus(""), cpus);
    machine(v2, "0::/a\n");
    put("cg/a/memory.max", "max\n");
    put("cg/a/cpu.max", "max 100000\n");
    ck_assert_uint_eq(host_ram_bytes(root), ram);
    ck_assert_uint_eq(host_cpus(root), cpus);
    machine(v1, v1_groups);
    put("cg/memory/a/b/memory.limit_in_bytes", "9223372036854771712\n");
    put("cg/cpu,cpuacct/a/cpu.cfs_quota_us", "-1\n");
    put("cg/cpu,cpuacct/a/cpu.cfs_period_us", "100000\n");
    ck_assert_uint_eq(host_ram_bytes(root), ram);
    ck_assert_uint_eq(host_cpus(root), cpus);
    put("cg/memory/a/b/memory.limit_in_bytes", "rubbish\n");
    machine("", "");
    ck_assert_uint_eq(host_ram_bytes(root), ram);
}
END_TEST

START_TEST(version_1) {
    machine(v1, v1_groups);
    put("cg/memory/a/b/memory.limit_in_bytes", "3000000\n");
    ck_assert_uint_eq(host_ram_bytes(root), 3000000);
    put("cg/memory/a/memory.limit_in_bytes", "2000000\n"); /* above us */
    ck_assert_uint_eq(host_ram_bytes(root), 2000000);
    put("cg/memory/a/b/c/memory.limit_in_bytes", "1000\n"); /* not ours */
    put("cg/cpuset/a/memory.limit_in_bytes", "1000\n");
    ck_assert_uint_eq(host_ram_bytes(root), 2000000);
    put("cg/memory/memory.limit_in_bytes", "1500000\n");
    ck_assert_uint_eq(host_ram_bytes(root), 1500000);
    put("cg/cpu,cpuacct/a/cpu.cfs_quota_us", "50000\n");
    put("cg/cpu,cpuacct/a/cpu.cfs_period_us", "100000\n");
    ck_assert_uint_eq(host_cpus(root), 1);
}
END_TEST

START_TEST(version_2) {
    machine(v2, "0::/user.slice/job\n");
    put("cg/user.slice/job/memory.max", "4000000\n");
    ck_assert_uint_eq(host_ram_bytes(root), 4000000);
    put("cg/user.slice/memory.high", "3000000\n");
    put("cg/user.slice/memory.max", "max\n");
    ck_assert_uint_eq(host_ram_bytes(root), 3000000);
    put("cg/user.slice/job/cpu.max", "1000 100000\n");
    ck_assert_uint_eq(host_cpus(root), 1);
    put("cg/user.slice/job/cpu.max", "100000000 100000\n"); /* more than there are */
    ck_assert_uint_eq(host_cpus(root), host_cpus("/nowhere"));
}
END_TEST

/* A container that sees its own group as the mount, by its name outside or as "/"; or is told of a
 * group outside of what it sees. */
START_TEST(containers) {
    static const char mounted[] = "35 31 0:32 /docker/7f /cg ro - cgroup2 cgroup2 rw\n";
    put("cg/memory.max", "5000000\n");
    put("cg/in/memory.max", "4000000\n");
    put("cg/docker/7f/memory.max", "1000\n"); /* another's, of the same name */
    machine(mounted, "0::/docker/7f\n");
    ck_assert_uint_eq(host_ram_bytes(root), 5000000);
    machine(mounted, "0::/docker/7f/in\n");
    ck_assert_uint_eq(host_ram_bytes(root), 4000000);
    machine(v2, "0::/\n");
    ck_assert_uint_eq(host_ram_bytes(root), 5000000);
    machine(v2, "0::/../other\n");
    ck_assert_uint_eq(host_ram_bytes(root), 5000000);
}
END_TEST

START_TEST(affinity) {
    cpu_set_t all, one;
    CPU_ZERO(&one);
    ck_assert_int_eq(sched_getaffinity(0, sizeof all, &all), 0);
    for (int i = 0; i < CPU_SETSIZE && CPU_COUNT(&one) == 0; i++)
        if (CPU_ISSET(i, &all))
            CPU_SET(i, &one);
    ck_assert_int_eq(sched_setaffinity(0, sizeof one, &one), 0);
    ck_assert_uint_eq(host_cpus("/nowhere"), 1);
    ck_assert_int_eq(sched_setaffinity(0, sizeof all, &all), 0);
    ck_assert_uint_eq(host_cpus("/nowhere"), CPU_COUNT(&all));
}
END_TEST

int main(void) {
    if (mkdtemp(root) == NULL)
        return 1;
    Suite *suite = suite_create("host");
    TCase *tc = tcase_create("host");
    tcase_add_checked_fixture(tc, setup, NULL);
    tcase_add_test(tc, no_limits);
    tcase_add_test(tc, version_1);
    tcase_add_test(tc, version_2);
    tcase_add_test(tc, containers);
    tcase_add_test(tc, affinity);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    clear();
    rmdir(root);
    return failed;
}
