/* mn_fail: the one place where an error text is made; and what an errno means. Any thread; owns
 * nothing. */
#include "metanode/status.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>

mn_code mn_fail(mn_status *st, mn_code code, const char *format, ...) {
    if (st != NULL && st->code == MN_OK) {
        va_list args;
        va_start(args, format);
        vsnprintf(st->text, sizeof st->text, format, args);
        va_end(args);
        st->code = code;
    }
    return code;
}

mn_code mn_code_of_write(int error) {
    return error == ENOSPC || error == EDQUOT || error == EFBIG ? MN_NO_SPACE : MN_FAILED;
}
