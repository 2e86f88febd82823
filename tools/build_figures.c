/* The figures of build, simplify and block: as JSON, or as a few lines. Hidden here: the keys. */
#include <float.h>
#include <stdio.h>

#include "build_steps.h"

void build_json_tree(json *j, const mn_tree *t) {
    const mn_intake *in = &t->intake;
    const mn_build_counts *c = &t->counts;
    json_u64(j, "vertices", t->leaves);
    json_u64(j, "triangles", t->triangles);
    json_u64(j, "input_faces", in->input_faces);
    json_u64(j, "duplicate_faces", in->duplicate_faces);
    json_u64(j, "degenerate_faces", in->degenerate_faces);
    json_u64(j, "nonfinite_faces", in->nonfinite_faces);
    json_u64(j, "misoriented_faces", in->misoriented_faces);
    json_u64(j, "unused_vertices", in->unused_vertices);
    json_u64(j, "welded_vertices", in->welded_vertices);
    json_u64(j, "merged_positions", in->merged_positions);
    json_f64(j, "grid_step", (double)t->grid_step);
    json_u64(j, "nonmanifold_edges", c->nonmanifold_edges);
    json_u64(j, "boundary_edges", c->boundary_edges);
    json_u64(j, "components", c->components);
    json_u64(j, "roots", t->roots);
    json_u64(j, "nodes", (uint64_t)t->leaves + t->inner);
    json_u64(j, "hinges", t->simplices - t->triangles);
    json_open(j, "collapses_by_stage", '[');
    for (int i = 0; i < 4; i++)
        json_u64(j, NULL, c->collapses_by_stage[i]);
    json_close(j, ']');
    json_u64(j, "virtual_collapses", c->collapses_by_stage[3]);
    json_u64(j, "legal_last", t->legal_last);
    json_u64(j, "depth_max", t->depth_max);
}

/* What is reported of all phases that were gone through. */
typedef struct sums {
    uint64_t bytes_read, bytes_written;
    mn_vdt_figures phase;
} sums;

static sums add_up(const build_steps *b) {
    sums s = {.bytes_read = b->blocked.bytes_read, .bytes_written = b->blocked.bytes_written};
    if (b->vdt == NULL)
        return s;
    s.phase = *mn_vdt_figures_of(b->vdt);
    const mn_phase_figures *const phases[] = {&s.phase.read, &s.phase.simplify, &s.phase.order};
    for (int i = 0; i < 3; i++) {
        s.bytes_read += phases[i]->bytes_read;
        s.bytes_written += phases[i]->bytes_written;
    }
    return s;
}

static void json_phase(json *j, const char *name, const mn_phase_figures *phase) {
    char key[40];
    snprintf(key, sizeof key, "seconds_%s", name);
    json_f64(j, key, phase->seconds);
    snprintf(key, sizeof key, "cpu_seconds_%s", name);
    json_f64(j, key, phase->cpu_seconds);
    snprintf(key, sizeof key, "bytes_read_%s", name);
    json_u64(j, key, phase->bytes_read);
    snprintf(key, sizeof key, "bytes_written_%s", name);
    json_u64(j, key, phase->bytes_written);
}

static void json_bytes(json *j, const build_steps *b, const sums *s) {
    json_u64(j, "bytes_read", s->bytes_read);
    json_u64(j, "bytes_written", s->bytes_written);
    if (b->work != NULL) {
        json_u64(j, "temp_bytes_planned", b->temp.planned_bytes);
        json_u64(j, "temp_bytes_peak", b->temp.peak_bytes);
    }
    json_u64(j, "file_bytes", cli_file_bytes(b->out));
    json_f64(j, "bytes_per_vertex", (double)cli_file_bytes(b->out) / b->head->leaves);
}

static void report_json(const build_steps *b) {
    const mn_tree *t = b->head;
    const mn_header *h = &b->header;
    const sums s = add_up(b);
    const mn_phase_figures block = {b->blocked.seconds_block, b->blocked.bytes_read,
                                    b->blocked.bytes_written, b->blocked.cpu_seconds_block};
    json j;
    json_begin(&j, stdout);
    build_json_tree(&j, t);
    if (h->blocks > 0) {
        json_u64(&j, "block_depth", h->block_depth);
        json_u64(&j, "blocks", h->blocks);
        json_f64(&j, "fill_mean", h->fill_mean);
    }
    json_u64(&j, "order_violations", t->counts.order_violations);
    json_f64(&j, "order_violation_worst", (double)t->counts.order_violation_worst);
    json_f64(&j, "order_violation_bound", (double)t->counts.order_violation_bound);
    json_u64(&j, "order_unknown", t->counts.order_unknown);
    json_u64(&j, "rounds", t->counts.rounds);
    if (b->work != NULL) { /* simplified */
        if (s.phase.simplify.seconds > 0)
            json_f64(&j, "collapses_per_second", t->inner / s.phase.simplify.seconds);
        else
            json_null(&j, "collapses_per_second");
        json_phase(&j, "read", &s.phase.read);
        json_phase(&j, "simplify", &s.phase.simplify);
        json_phase(&j, "order", &s.phase.order);
    }
    if (h->blocks > 0)
        json_phase(&j, "block", &block);
    json_bytes(&j, b, &s);
    json_cap(&j, "ram_cap_bytes", b->ram_bytes);
    json_u64(&j, "rss_peak_bytes", cli_rss_peak_bytes());
    if (h->blocks > 0) {
        json_u64(&j, "l", h->l);
        json_u64(&j, "block_bytes", h->block_bytes);
    }
    json_str(&j, "metric", build_metric_name(t->metric));
    if (h->blocks > 0)
        json_str(&j, "blocking", build_blocking_name(h->blocking));
    json_end(&j);
}

/* Nothing where cheapest first was kept throughout. */
static void report_order(const mn_build_counts *c) {
    if (c->order_violation_bound >= FLT_MAX)
        printf("  out of order: %llu collapse%s beside a legal one that was next to free\n",
               (unsigned long long)c->order_violations, cli_s(c->order_violations));
    else if (c->order_violations > 0)
        printf("  out of order: %llu collapse%s beside a cheaper legal one, at most %.3g times as "
               "dear\n",
               (unsigned long long)c->order_violations, cli_s(c->order_violations),
               (double)c->order_violation_bound);
    if (c->order_unknown > 0)
        printf("  order not known: %llu collapse%s at hubs or of points\n",
               (unsigned long long)c->order_unknown, cli_s(c->order_unknown));
}

static void report_text(const build_steps *b) {
    const mn_tree *t = b->head;
    const mn_header *h = &b->header;
    const mn_intake *in = &t->intake;
    const double seconds = b->work != NULL ? mn_vdt_figures_of(b->vdt)->simplify.seconds : 0;
    const uint64_t rejected = in->duplicate_faces + in->degenerate_faces + in->nonfinite_faces;
    const uint32_t hinges = t->simplices - t->triangles;
    printf("%s: %u vertices, %u triangle%s, %u hinge%s, depth %u\n", b->out, t->leaves,
           t->triangles, cli_s(t->triangles), hinges, cli_s(hinges), t->depth_max);
    if (rejected > 0)
        printf("  rejected %llu face%s: %llu duplicate, %llu degenerate, %llu not finite\n",
               (unsigned long long)rejected, cli_s(rejected),
               (unsigned long long)in->duplicate_faces, (unsigned long long)in->degenerate_faces,
               (unsigned long long)in->nonfinite_faces);
    if (in->merged_positions > 0)
        printf("  %llu position%s together with others\n", (unsigned long long)in->merged_positions,
               in->merged_positions == 1 ? " falls" : "s fall");
    if (seconds > 0)
        printf("  %u collapse%s in %.2f s (%.0f/s)\n", t->inner, cli_s(t->inner), seconds,
               t->inner / seconds);
    report_order(&t->counts);
    if (h->blocks > 0)
        printf("  %u block%s of up to %u bytes, filled %.0f %%, %u deep\n", h->blocks,
               cli_s(h->blocks), h->block_bytes_max, 100 * h->fill_mean, h->block_depth);
    const uint64_t file_bytes = cli_file_bytes(b->out);
    printf("  %llu bytes, %.1f a vertex\n", (unsigned long long)file_bytes,
           (double)file_bytes / t->leaves);
}

/* Trees are as unbalanced as surfaces are: the longest block decides how much room all take. */
static void warn_of_empty_blocks(const build_steps *b) {
    if (b->header.blocks > 1 && b->header.l > 0 && b->header.fill_mean < 0.5)
        fprintf(
            stderr,
            "metanode: warning: blocks of %u levels are filled %.0f %%; no other -L fills those of "
            "such a tree, --blocking packed does\n",
            b->header.l, 100 * b->header.fill_mean);
}

void build_report(const build_steps *b) {
    warn_of_empty_blocks(b);
    if (b->json)
        report_json(b);
    else
        report_text(b);
}
