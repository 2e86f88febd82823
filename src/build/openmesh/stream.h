/* The one form in which meshes travel between metanode and metanode-openmesh, both ways:
 *
 *   8 bytes "MNOMSTRM", u64 vertices, u64 triangles, u32 has_colors, u32 zero,
 *   vertices × 3 double, [vertices × u32 RGBA8, R in the low byte,] triangles × 3 u32
 *
 * little-endian, nothing after it. src/build/helper.h speaks the other end. One thread. */
#ifndef METANODE_OPENMESH_STREAM_H
#define METANODE_OPENMESH_STREAM_H

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

/* What the user gets to read: one line, then exit 3. */
struct trouble : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/* Triangles without any connectivity, so that any input fits. */
struct soup {
    std::vector<double> position; /* 3 a vertex */
    std::vector<uint32_t> color;  /* one a vertex, or empty */
    std::vector<uint32_t> corner; /* 3 a triangle, each below vertices() */

    size_t vertices() const {
        return position.size() / 3;
    }
    size_t triangles() const {
        return corner.size() / 3;
    }
};

soup stream_read();              /* from standard input */
void stream_write(const soup &); /* to standard output, flushed */

/* One subcommand a file; args are what stands after its name. Each throws trouble. */
typedef std::vector<std::string> arguments;
void run_read(const arguments &args);
void run_write(const arguments &args);
void run_subdivide(const arguments &args);
void run_decimate(const arguments &args);

/* Takes "NAME VALUE" out of args; "" where it is absent. */
std::string take_option(arguments &args, const std::string &name);
uint64_t number(const std::string &text, const std::string &what, uint64_t min, uint64_t max);

#endif
