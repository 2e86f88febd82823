/* The page of metanode tune: see tune.h. Hidden here: HTML. One file, without scripts and without
 * anything from elsewhere: plots are SVGs in data URIs, so that their names cannot clash. */
#include <errno.h>
#include <math.h>
#include <string.h>

#include "cli.h"
#include "tune.h"

static const char style[] =
    "body{font:15px/1.5 sans-serif;color:#222;max-width:1240px;margin:2em auto;padding:0 1em}"
    "h1{font-size:1.6em}h2{font-size:1.25em;margin-top:2em;border-bottom:1px solid #ddd}"
    "table{border-collapse:collapse;font-size:13px;margin:1em 0}"
    "th,td{padding:.2em .6em;text-align:right;border-bottom:1px solid #eee;white-space:nowrap}"
    "th{background:#f4f6f8;cursor:help}th:first-child,td:first-child{text-align:left}"
    "td.no{text-align:left;color:#a33;white-space:normal}tr.best td{background:#e6f3e6}"
    "tr.all td{color:#666;font-style:italic}"
    "pre,code{background:#f4f6f8;font-size:13px}pre{padding:.7em;overflow-x:auto}"
    "img{max-width:100%;height:auto;border:1px solid #eee;margin:.6em 0}"
    ".box{background:#e6f3e6;padding:.8em 1.2em;border-radius:6px}.scroll{overflow-x:auto}";

static void text(FILE *f, const char *s) {
    for (; *s != 0; s++)
        switch (*s) {
        case '&':
            fputs("&amp;", f);
            break;
        case '<':
            fputs("&lt;", f);
            break;
        case '>':
            fputs("&gt;", f);
            break;
        case '"':
            fputs("&quot;", f);
            break;
        default:
            fputc(*s, f);
        }
}

static void base64(FILE *f, const char *bytes, size_t count) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const unsigned char *at = (const unsigned char *)bytes;
    for (size_t i = 0; i < count; i += 3) {
        const size_t left = count - i;
        const unsigned three = (unsigned)at[i] << 16 | (left > 1 ? (unsigned)at[i + 1] << 8 : 0) |
                               (left > 2 ? at[i + 2] : 0);
        fputc(digits[three >> 18], f);
        fputc(digits[three >> 12 & 63], f);
        fputc(left > 1 ? digits[three >> 6 & 63] : '=', f);
        fputc(left > 2 ? digits[three & 63] : '=', f);
    }
}

/* A word as a shell takes it. */
static void shell_word(FILE *f, const char *word) {
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                "-_./,=+:@%";
    fputc(' ', f);
    if (word[0] != 0 && word[strspn(word, plain)] == 0) {
        text(f, word);
        return;
    }
    fputc('\'', f);
    for (char piece[2] = {0}; *word != 0; word++) {
        piece[0] = *word;
        text(f, *word == '\'' ? "'\\''" : piece);
    }
    fputc('\'', f);
}

/* ---- tables ---------------------------------------------------------------------------------- */

static void heads(FILE *f, const tune_column *columns, int count) {
    fputs("<div class=scroll><table><tr>", f);
    for (int i = 0; i < count; i++) {
        fputs("<th title=\"", f);
        text(f, columns[i].means);
        fputs("\">", f);
        text(f, columns[i].head);
    }
    fputs("</tr>\n", f);
}

static void row(FILE *f, const char *kind, tune_text *texts, int count, int columns,
                const char *says) {
    fprintf(f, "<tr%s>", kind);
    for (int i = 0; i < count; i++) {
        fputs("<td>", f);
        text(f, texts[i]);
    }
    if (count < columns) {
        fprintf(f, "<td class=no colspan=%d>", columns - count);
        text(f, says);
    }
    fputs("</tr>\n", f);
}

static void layouts(const tune *t, FILE *f) {
    tune_text texts[TUNE_LAYOUT_COLUMNS];
    fputs("<h2>Layouts</h2>\n", f);
    heads(f, tune_layout_columns, TUNE_LAYOUT_COLUMNS);
    for (uint32_t i = 0; i < t->layouts; i++)
        row(f, "", texts, tune_layout_texts(&t->layout[i], texts), TUNE_LAYOUT_COLUMNS,
            t->layout[i].says);
    fputs("</table></div>\n", f);
}

static void cells(const tune *t, const tune_findings *found, uint32_t path, mn_prefetch rule,
                  FILE *f) {
    tune_text texts[TUNE_COLUMNS];
    const tune_cell *best = found->best != NULL ? found->best->cell + path : NULL;
    size_t count = 0;
    for (size_t i = 0; i < t->cells; i++)
        count += tune_cell_is_of(&t->cell[i], path, rule);
    if (count == 0)
        return;
    fputs("<h3>", f);
    text(f, t->o.path[path].label);
    fprintf(f, ", prefetch %s</h3>\n", tune_prefetch_name(rule));
    heads(f, tune_columns, TUNE_COLUMNS);
    for (size_t i = 0; i < t->cells; i++) {
        const tune_cell *c = &t->cell[i];
        const bool all = c->resident && c->path == path;
        if (all || tune_cell_is_of(c, path, rule))
            row(f,
                all         ? " class=all"
                : c == best ? " class=best"
                            : "",
                texts, tune_cell_texts(t, c, texts), TUNE_COLUMNS, c->says);
    }
    fputs("</table></div>\n", f);
}

/* ---- the page -------------------------------------------------------------------------------- */

static void best_line(const tune *t, const tune_setting *s, FILE *f) {
    char words[200];
    tune_text px;
    tune_setting_words(t, s, words, sizeof words);
    tune_pixels(s->error_px, px);
    fputs("<b>", f);
    text(f, words);
    fprintf(f, "</b>: error %s px, missed %.3g %%, p99 %.3g ms, peak %.3g MB", px,
            100 * s->miss_rate, s->p99_ms, s->ram_bytes / 1048576);
}

/* The setting, as commands. */
static void commands(const tune *t, const tune_setting *s, FILE *f) {
    const tune_cell *c = s->cell;
    const tune_layout *l = &t->layout[c->layout];
    const bool levels = l->blocking == MN_BLOCKING_LEVELS;
    fprintf(f, "<pre>metanode %s", strcmp(t->tree, t->o.in) == 0 ? "block" : "build");
    shell_word(f, t->o.in);
    fprintf(f, " --blocking %s %s %u -o model.mnt\nmetanode view model.mnt --prefetch %s",
            levels ? "levels" : "packed", levels ? "-L" : "--block-bytes", l->size,
            tune_prefetch_name(c->prefetch));
    if (t->o.cap[c->cap] > 0)
        fprintf(f, " --ram %llu", (unsigned long long)t->o.cap[c->cap]);
    if (t->o.places[c->places].kind != TUNE_FROM_CAP)
        fprintf(f, " -K %.0f", c->figure[TUNE_K]);
    fputs("</pre>\n", f);
}

static void best(const tune *t, const tune_findings *found, FILE *f) {
    char words[200];
    tune_want_words(&t->o.want, words, sizeof words);
    fputs("<h2>The best setting</h2>\n<p>Wanted: ", f);
    text(f, words);
    fputs("; of each setting the worst path counts", f);
    if (tune_others_words(t, words, sizeof words)) {
        fputs("; ", f);
        text(f, words);
    }
    fputs(".</p>\n<div class=box>", f);
    if (found->best == NULL) {
        fputs("No setting keeps to that on all paths.</div>\n", f);
    } else {
        best_line(t, found->best, f);
        fputs("</div>\n", f);
        commands(t, found->best, f);
    }
    fputs("<p>With as many place holders:</p><ul>\n", f);
    for (uint32_t cap = 0; cap < t->o.caps; cap++)
        for (uint32_t places = 0; places < t->o.places_count; places++) {
            const tune_setting *s = tune_best_of(t, found, cap, places);
            if (s == NULL)
                continue;
            fputs("<li>", f);
            best_line(t, s, f);
            fputs("\n", f);
        }
    fputs("</ul>\n", f);
}

static void settings(const tune *t, FILE *f) {
    const tune_options *o = &t->o;
    fputs("<h2>How it was measured</h2>\n<table>\n<tr><td>input<td style='text-align:left'>", f);
    text(f, o->in);
    fputs("</tr>\n<tr><td>program<td style='text-align:left'>metanode ", f);
    text(f, t->program);
    fputs("</tr>\n<tr><td>machine<td style='text-align:left'>", f);
    text(f, t->machine);
    fputs("</tr>\n<tr><td>paths<td style='text-align:left'>", f);
    for (uint32_t i = 0; i < o->paths; i++) {
        text(f, i > 0 ? "; " : "");
        text(f, o->path[i].label);
        fprintf(f, ", %u frame%s", o->path[i].frames, cli_s(o->path[i].frames));
    }
    fputs("</tr>\n<tr><td>flown<td style='text-align:left'>", f);
    fprintf(f,
            "%s frames a second, picture %s, tolerance %s px, degrading %s, frames begin with %s, "
            "times of the "
            "%s</tr>",
            o->fps, o->size, o->tolerance, o->degrade,
            strcmp(o->open, "roots") == 0 ? "the roots" : "what the first picture needs",
            o->want.cpu ? "processor" : "clock");
    fprintf(
        f,
        "\n</table>\n<p>Each cell is a process of its own (<code>replay --paced --open %s</code>)",
        o->open);
    fputs(
        ", one at a time: Navigate has one processor, its I/O thread another, nothing else of ours "
        "runs. Files are read past the page cache. What other programs took meanwhile is in the "
        "last column. The command:</p>\n<pre>metanode",
        f);
    for (int i = 0; i < o->argc; i++)
        shell_word(f, o->argv[i]);
    fputs("</pre>\n", f);
}

static void explain(FILE *f) {
    fputs("<h2>Columns</h2>\n<ul>\n", f);
    for (int i = 1; i < TUNE_COLUMNS; i++) {
        fputs("<li><b>", f);
        text(f, tune_columns[i].head);
        fputs("</b>: ", f);
        text(f, tune_columns[i].means);
        fputs("\n", f);
    }
    fputs("</ul>\n", f);
}

static void pictures(const tune_plots *p, FILE *f) {
    fputs("<h2>Plots</h2>\n", f);
    if (p->says[0] != 0) {
        fputs("<p>", f);
        text(f, p->says);
        fputs("</p>\n", f);
    }
    for (uint32_t i = 0; i < p->count; i++) {
        fprintf(f, "<img alt=\"%s\" width=%u height=%u src=\"data:image/svg+xml;base64,",
                p->plot[i].name, p->plot[i].width, p->plot[i].height);
        base64(f, p->plot[i].svg, p->plot[i].svg_bytes);
        fputs("\">\n", f);
    }
}

mn_code tune_report(const tune *t, const tune_findings *found, const tune_plots *p, mn_status *st) {
    char path[PATH_MAX];
    FILE *f = tune_file_name(t, "report.html", path, sizeof path) == 0 ? fopen(path, "we") : NULL;
    if (f == NULL)
        return mn_fail(st, mn_code_of_write(errno), "%s/report.html: cannot be written: %s; %s",
                       t->o.folder, strerror(errno), cli_write_advice(errno));
    const char *slash = strrchr(t->o.in, '/'), *name = slash != NULL ? slash + 1 : t->o.in;
    fputs("<!doctype html>\n<html lang=en><meta charset=utf-8><title>metanode tune: ", f);
    text(f, name);
    fprintf(f, "</title>\n<style>%s</style>\n<h1>metanode tune: ", style);
    text(f, name);
    fprintf(f, "</h1>\n<p>%u vertices, %llu triangles.</p>\n", t->layout[t->smallest].header.leaves,
            (unsigned long long)t->layout[t->smallest].header.triangles);
    best(t, found, f);
    settings(t, f);
    layouts(t, f);
    pictures(p, f);
    fputs("<h2>Cells</h2>\n", f);
    for (uint32_t i = 0; i < t->o.paths; i++)
        for (uint32_t r = 0; r < t->o.prefetches; r++)
            cells(t, found, i, t->o.prefetch[r], f);
    explain(f);
    fputs("</html>\n", f);
    return cli_written_all(f, "tune:", path, st);
}
