/* y = k u, n_out = n_in + 1, b_out = not b_in; from fail_at on, steps fail as fail_as says
 * (1 warns, 2 discard, 3 error, 4 asks to stop, 9 takes the process with it); steps above `longest` are discarded */
enum { U, Y, K, FAIL_AT, FAIL_AS, LONGEST, REALS };
#define STATES 0
#define INPUTS (1u << U)
#define SLOPES_AT_ONCE 0
#include "small_fmu.h"

static void start_values(values *v) { v->r[K] = 2, v->r[FAIL_AT] = 1e9, v->r[FAIL_AS] = 3, v->r[LONGEST] = 1e9; }
static void derivatives(const values *v, double *dx) { UNUSED(v), UNUSED(dx); }
static void outputs(values *v) {
  v->r[Y] = v->r[K] * v->r[U];
  v->n[1] = v->n[0] + 1;
  v->b[1] = !v->b[0];
}
static fmi2Status step_status(unit *m, double t, double h) {
  if (h > m->v.r[LONGEST]) return fmi2Discard;
  if (t + h <= m->v.r[FAIL_AT]) return fmi2OK;
  if (m->v.r[FAIL_AS] == 9) abort();
  if (m->v.r[FAIL_AS] == 4) return m->v.stopped = true, fmi2Discard;
  m->call.logger(m->call.componentEnvironment, m->name, (fmi2Status)m->v.r[FAIL_AS], "logStatus", "no more after %g s",
                 m->v.r[FAIL_AT]);
  return (fmi2Status)m->v.r[FAIL_AS];
}
