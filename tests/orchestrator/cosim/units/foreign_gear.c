/* A gearhead as somebody else writes it: stiff mesh without a gap, no flanges, no annotation; the ports are named as ours.
 * J_o dw_o/dt = tau_g - tau_s,  tau_g = c (phi/N - phi_o) + d (w/N - w_o),  tau = tau_g/(N eta) + f w */
enum { PHI_O, W_O, TAU, TAU_G, J_COUPLED, PHI, W, TAU_S, N, C, D, REALS };
#define STATES 2
#define INPUTS (1u << PHI | 1u << W | 1u << TAU_S)
#define SLOPES_AT_ONCE 0
#include "small_fmu.h"

static void start_values(values *v) { v->r[N] = 338.0 / 3, v->r[C] = 3000, v->r[D] = 0.5, v->r[J_COUPLED] = 9.3e-7; }
static double mesh(const values *v) {
  return v->r[C] * (v->r[PHI] / v->r[N] - v->r[PHI_O]) + v->r[D] * (v->r[W] / v->r[N] - v->r[W_O]);
}
static void derivatives(const values *v, double *dx) {
  dx[PHI_O] = v->r[W_O];
  dx[W_O] = (mesh(v) - v->r[TAU_S]) / 4e-4;
}
static void outputs(values *v) {
  v->r[TAU_G] = mesh(v);
  v->r[TAU] = v->r[TAU_G] / v->r[N] / 0.75 + 1e-5 * v->r[W];
}
static fmi2Status step_status(unit *m, double t, double h) {
  UNUSED(m), UNUSED(t), UNUSED(h);
  return fmi2OK;
}
