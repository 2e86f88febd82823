#include "plan.h"
mn_code mni_plan_packed(mni_plan *plan, mn_status *st) {
    (void)plan;
    return mn_fail(st, MN_USAGE, "packed: not yet");
}
