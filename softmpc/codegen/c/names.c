/* Words for the codes of controller.h. */
#include "controller.h"

static const char *one_of(const char *const *names, int count, int code)
{
    return code >= 0 && code < count ? names[code] : "unknown";
}

const char *smpc_status_name(int status)
{
    static const char *const names[] = {
        "solved", "iteration cap", "budget overrun", "input not finite", "failed"};
    return one_of(names, 5, status);
}

const char *smpc_qp_name(int qp)
{
    static const char *const names[] = {
        "not asked", "optimal", "not optimal", "infeasible", "cycling", "iteration limit",
        "not convex", "time limit", "not finite", "singular", "too many rows"};
    return one_of(names, 11, qp);
}
