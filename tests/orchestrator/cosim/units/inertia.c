/* J dw/dt = tau_drive - tau, dphi/dt = w, phi(0) = phi_0; flange with work */
enum { PHI, W, WORK, WORK_ABS, TAU, TAU_DRIVE, J, PHI_0, REALS };
#define STATES 4
#define INPUTS (1u << TAU | 1u << TAU_DRIVE)
#define SLOPES_AT_ONCE 1
#include "small_fmu.h"

static void start_values(values *v) { v->r[PHI_0] = 1, v->r[J] = 1; }
static void derivatives(const values *v, double *dx) {
  dx[PHI] = v->r[W];
  dx[W] = (v->r[TAU_DRIVE] - v->r[TAU]) / v->r[J];
  dx[WORK] = v->r[TAU] * v->r[W];
  dx[WORK_ABS] = fabs(dx[WORK]);
}
static void outputs(values *v) {
  if (v->initialising) v->r[PHI] = v->r[PHI_0];
}
static fmi2Status step_status(unit *m, double t, double h) {
  UNUSED(m), UNUSED(t), UNUSED(h);
  return fmi2OK;
}
