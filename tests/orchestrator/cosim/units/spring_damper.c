/* tau = c phi + d w; flange with work */
enum { WORK, WORK_ABS, PHI, W, TAU, C, D, REALS };
#define STATES 2
#define INPUTS (1u << PHI | 1u << W)
#define SLOPES_AT_ONCE 0
#include "small_fmu.h"

static void start_values(values *v) { v->r[C] = 1, v->r[D] = 0.1; }
static void derivatives(const values *v, double *dx) {
  dx[WORK] = v->r[TAU] * v->r[W];
  dx[WORK_ABS] = fabs(dx[WORK]);
}
static void outputs(values *v) { v->r[TAU] = v->r[C] * v->r[PHI] + v->r[D] * v->r[W]; }
static fmi2Status step_status(unit *m, double t, double h) {
  UNUSED(m), UNUSED(t), UNUSED(h);
  return fmi2OK;
}
