/* J dw/dt = u - tau_C tanh(w/0.5) - d w - c w |w| - tau_A tanh(w/0.5)^2, dphi/dt = w, for a diagnosis to look at;
 * where tau_A is not 0, or d beyond d_most, the process is gone */
#include <stdlib.h>

enum { PHI, W, U, J, D, TAU_C, C, TAU_A, D_MOST, REALS };
#define STATES 2
#define INPUTS (1u << U)
#define SLOPES_AT_ONCE 1
#include "small_fmu.h"

static void start_values(values *v) { v->r[J] = 1e-2, v->r[D] = 2e-2, v->r[TAU_C] = 0.02, v->r[D_MOST] = 1; }
static void derivatives(const values *v, double *dx) {
  const double w = v->r[W], s = tanh(w / 0.5);
  dx[PHI] = w;
  dx[W] = (v->r[U] - v->r[TAU_C] * s - v->r[D] * w - v->r[C] * w * fabs(w) - v->r[TAU_A] * s * s) / v->r[J];
}
static void outputs(values *v) { UNUSED(v); }
static fmi2Status step_status(unit *m, double t, double h) {
  if (m->v.r[TAU_A] != 0 || m->v.r[D] > m->v.r[D_MOST]) abort();
  return UNUSED(t), UNUSED(h), fmi2OK;
}
