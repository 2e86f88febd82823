/* metanode-openmesh: the only place that links OpenMesh, a process of its own because OpenMesh's
 * readers are not safe for files from anywhere and because linking it costs 5 MB before main.
 *
 *   metanode-openmesh read FILE --as om|ply|obj|off|stl [--ram BYTES] [--seconds N]   mesh out
 *   metanode-openmesh write FILE --as om|ply|obj|off|stl                               mesh in
 *   metanode-openmesh subdivide --times N                                         mesh in, out
 *   metanode-openmesh decimate --triangles N                                      mesh in, out
 *
 * Meshes in and out are streams on standard input and output (stream.h). --ram and --seconds, which
 * every subcommand takes, are this process's own limits of address space and processor time. Any
 * trouble is one line on standard error and exit 3; past --seconds the kernel ends it by SIGXCPU.
 */
#include "stream.h"

#include <OpenMesh/Core/System/omstream.hh>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <new>
#include <sys/resource.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define LIMIT_ADDRESS_SPACE 0 /* a sanitizer's shadow takes terabytes of it */
#else
#define LIMIT_ADDRESS_SPACE 1
#endif

std::string take_option(arguments &args, const std::string &name) {
    for (size_t i = 0; i + 1 < args.size(); i++)
        if (args[i] == name) {
            std::string value = args[i + 1];
            args.erase(args.begin() + (long)i, args.begin() + (long)i + 2);
            return value;
        }
    return "";
}

uint64_t number(const std::string &text, const std::string &what, uint64_t min, uint64_t max) {
    char *end = nullptr;
    unsigned long long value = strtoull(text.c_str(), &end, 10);
    if (text.empty() || text[0] < '0' || text[0] > '9' || *end != 0 || value < min || value > max)
        throw trouble(what + " '" + text + "' is not a number in " + std::to_string(min) + " … " +
                      std::to_string(max));
    return value;
}

static void limit(int resource, const std::string &text, const std::string &what) {
    if (text.empty())
        return;
    rlimit r;
    r.rlim_cur = number(text, what, 1, INT64_MAX / 2);
    r.rlim_max = r.rlim_cur + 1; /* at the hard limit the kernel kills without a reason */
    if (setrlimit(resource, &r) != 0)
        throw trouble("cannot set the limit " + what);
}

static void run(arguments args) {
    static const struct {
        const char *name;
        void (*run)(const arguments &);
    } commands[] = {{"read", run_read},
                    {"write", run_write},
                    {"subdivide", run_subdivide},
                    {"decimate", run_decimate}};
    rlimit no_core = {0, 0};
    setrlimit(RLIMIT_CORE, &no_core);
    std::string ram = take_option(args, "--ram");
    if (LIMIT_ADDRESS_SPACE)
        limit(RLIMIT_AS, ram, "--ram");
    limit(RLIMIT_CPU, take_option(args, "--seconds"), "--seconds");
    if (args.empty())
        throw trouble("no command; one of read, write, subdivide, decimate");
    for (const auto &c : commands)
        if (args[0] == c.name)
            return c.run(arguments(args.begin() + 1, args.end()));
    throw trouble("no command '" + args[0] + "'; one of read, write, subdivide, decimate");
}

int main(int argc, char **argv) {
    /* OpenMesh tells all it meets, by its own streams and by C++'s: a line for each lost number. */
    omlog().disable();
    omout().disable();
    omerr().disable();
    for (std::ostream *chatter : {&std::cout, &std::cerr, &std::clog})
        chatter->setstate(std::ios::badbit);
    try {
        run(arguments(argv + 1, argv + argc));
        return 0;
    } catch (const std::bad_alloc &) {
        fputs("it takes more memory than the limit of this reader\n", stderr);
    } catch (const std::length_error &) {
        fputs("its counts are beyond any memory\n", stderr);
    } catch (const std::exception &e) {
        fprintf(stderr, "%s\n", e.what());
    }
    return 3;
}
