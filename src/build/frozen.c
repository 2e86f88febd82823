/* See frozen.h. Hidden here: how parts of a leaf are added up. */
#include "frozen.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "metanode/format.h"

bool mni_frozen_open(mni_frozen_table *t, const mni_ghost *hub, uint32_t count) {
    *t = (mni_frozen_table){.count = count};
    t->hub = calloc((size_t)count + 1, sizeof *t->hub);
    if (t->hub == NULL)
        return false;
    for (uint32_t i = 0; i < count; i++) {
        mni_wire_vertex *v = &t->hub[i].is;
        v->id = v->node = hub[i].id;
        v->leaves = v->levels = 1;
        memcpy(v->p, hub[i].position, sizeof v->p);
        for (int w = 0; w < MNI_WITNESSES; w++)
            v->points.slack[w] = -1;
    }
    return true;
}

void mni_frozen_close(mni_frozen_table *t) {
    free(t->hub);
    *t = (mni_frozen_table){0};
}

void mni_frozen_copy(mni_frozen_table *to, const mni_frozen_table *from) {
    memcpy(to->hub, from->hub, from->count * sizeof *to->hub);
    for (uint32_t i = 0; i < to->count; i++)
        if (to->hub[i].aside)
            to->hub[i].is.value = fmaxf(to->hub[i].is.value, to->hub[i].is.bounds.radius);
}

uint32_t mni_frozen_find(const mni_frozen_table *t, uint32_t id) {
    uint32_t low = 0, high = t->count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (t->hub[middle].is.id < id)
            low = middle + 1;
        else
            high = middle;
    }
    return low < t->count && t->hub[low].is.id == id ? low : MN_NONE;
}

void mni_frozen_add(mni_frozen *to, const mni_wire_vertex *part) {
    mni_wire_vertex *v = &to->is;
    v->bounds.radius = fmaxf(v->bounds.radius, part->bounds.radius);
    v->bounds.cone =
        to->seen ? mn_cone_merge(v->bounds.cone, part->bounds.cone) : part->bounds.cone;
    to->seen = true;
    for (int i = 0; i < 10; i++)
        v->quadric[i] += part->quadric[i];
    for (int from = 0, at = 0; from < MNI_WITNESSES && part->points.slack[from] >= 0; from++) {
        while (at < MNI_WITNESSES && v->points.slack[at] >= 0)
            at++;
        if (at == MNI_WITNESSES)
            break;
        v->points.x[at] = part->points.x[from];
        v->points.y[at] = part->points.y[from];
        v->points.z[at] = part->points.z[from];
        v->points.slack[at] = 0;
    }
}

void mni_frozen_raise(mni_frozen *to, float value, float around) {
    to->is.value = fmaxf(to->is.value, value);
    to->around = fmaxf(to->around, around);
}
