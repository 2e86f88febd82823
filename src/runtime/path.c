#include "metanode/runtime.h"
void mn_path_close(mn_path *p) {
    (void)p;
}
