/* Which setting is best: see tune.h. Pure; any thread. */
#include <math.h>

#include "tune.h"

/* Figures of two runs of one setting differ by so much: what is within it counts as equal. */
static const double ALIKE = 1.02;

static double worse(double a, double b) {
    return b > a || isnan(b) ? b : a;
}

static tune_setting setting_of(const tune_cell *cells, uint32_t paths, bool cpu) {
    tune_setting s = {.cell = cells, .whole = true};
    for (uint32_t i = 0; i < paths; i++) {
        const tune_cell *c = &cells[i];
        s.whole &= c->state == TUNE_MEASURED;
        s.error_px = worse(s.error_px, c->figure[TUNE_ERROR_P95]);
        s.miss_rate = worse(s.miss_rate, c->figure[TUNE_MISS_RATE]);
        s.p99_ms = worse(s.p99_ms, tune_p99_ms(c, cpu));
        s.ram_bytes = worse(s.ram_bytes, c->figure[TUNE_RSS_BYTES]);
        s.pool_bytes = worse(s.pool_bytes, c->figure[TUNE_K] * c->figure[TUNE_BLOCK_BYTES]);
    }
    return s;
}

size_t tune_settings(const tune_cell *cells, size_t count, uint32_t paths, bool cpu,
                     tune_setting *out, size_t room) {
    size_t settings = 0;
    for (size_t i = 0; i + paths <= count && settings < room; i += paths)
        if (!cells[i].resident)
            out[settings++] = setting_of(&cells[i], paths, cpu);
    return settings;
}

bool tune_keeps_to(const tune_setting *s, const tune_want *want) {
    return s->whole && s->p99_ms <= want->p99_ms && s->error_px <= want->error_px &&
           s->miss_rate <= want->miss_rate && s->ram_bytes <= want->ram_bytes;
}

static double objective_of(const tune_setting *s, tune_objective objective) {
    switch (objective) {
    case TUNE_MISSES:
        return s->miss_rate;
    case TUNE_P99:
        return s->p99_ms;
    case TUNE_RAM:
        return s->ram_bytes;
    case TUNE_ERROR:
    default:
        return s->error_px;
    }
}

const tune_setting *tune_choose(const tune_setting *settings, size_t count, const tune_want *want) {
    const tune_setting *best = NULL;
    double least = INFINITY;
    for (size_t i = 0; i < count; i++)
        if (tune_keeps_to(&settings[i], want))
            least = fmin(least, objective_of(&settings[i], want->objective));
    for (size_t i = 0; i < count; i++) {
        const tune_setting *s = &settings[i];
        if (!tune_keeps_to(s, want) || objective_of(s, want->objective) > ALIKE * least)
            continue;
        if (best == NULL || s->pool_bytes < best->pool_bytes ||
            (s->pool_bytes == best->pool_bytes && s->p99_ms < best->p99_ms))
            best = s;
    }
    return best;
}
