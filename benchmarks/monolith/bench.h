/* The bench of the base model as one set of equations: parameters, gearhead, torque sensor, belt and brake.
 * Written apart from the FMUs, so that a comparison with them can fail. SI units; shaft angles phi, speeds w. */
#ifndef MONOLITH_BENCH_H
#define MONOLITH_BENCH_H

#include <math.h>
#include <stddef.h>

/* Inputs at one instant, and one row of the inputs' table (piecewise linear between rows, 1 kHz). */
typedef struct {
  double v;     /* winding voltage, V */
  double i_b;   /* brake current, A */
  double tau_h; /* capacity of the hand's grip, N.m; with MOTOR_ALONE: torque on the rotor, N.m */
} inputs;

typedef enum { LOADED, NO_LOAD, MOTOR_ALONE } setup;

enum { PHI, W, PHI_O, W_O, PHI_P, W_P, PHI_B, W_B, TAU_M, MECHANICAL_STATES };

typedef struct {
  double tau_g, tau_s, tau_belt;
} torques;

static const double R = 0.209, L = 84.3e-6, k = 0.0232; /* winding, phase to phase */
static const double J_rotor = 5.38e-6, J_coupled = 9.3e-7, w_C = 1.0;
static const double tau_C_motor = 1.2e-3, d_motor = 7.5e-6;
static const double N = 338.0 / 3.0, eta = 0.75, tau_C_gear = 1.236e-3, d_gear = 1.05e-5;
static const double c = 3000.0, d_g = 0.5, b = 3.14159265358979323846 / 180.0, P_0 = 1.0, J_o = 4e-4;
static const double c_s = 955.0, d_s = 0.2;
static const double J_p = 2e-3, r = 4.1, c_b = 60.0, d_b = 0.05, J_b = 3e-4;
static const double tau_off = 0.08, d_off = 1e-3, k_b = 2.5, tau_lin = 2.5, tau_max = 3.84, omega_m = 62.0;
static const double w_b0 = 0.5, w_h = 0.02;

/* f(i): linear up to tau_lin, saturating at tau_max */
static inline double brake_curve(double i_b) {
  const double linear = k_b * fabs(i_b), h = tau_max - tau_lin;
  return linear <= tau_lin ? linear : tau_lin + h * (1.0 - exp(-(linear - tau_lin) / h));
}

/* tau_g of the gap b: damping acts in contact only, and a contact never pulls */
static inline double mesh_torque(double delta, double ddelta) {
  if (delta > 0.5 * b) return fmax(0.0, c * (delta - 0.5 * b) + d_g * ddelta);
  if (delta < -0.5 * b) return fmin(0.0, c * (delta + 0.5 * b) + d_g * ddelta);
  return 0.0;
}

/* Derivatives of the mechanical states under the electromagnetic torque tau_e; returns the shaft torques. */
static inline torques mechanics(setup set_up, const double x[], inputs u, double tau_e, double der[]) {
  const double J = J_rotor + (set_up == MOTOR_ALONE ? 0.0 : J_coupled);
  const double sgn_w = tanh(x[W] / w_C); /* one shaft, one w_C: motor and gearhead share it */
  torques shaft = {0.0, 0.0, 0.0};
  double tau = u.tau_h;

  for (int n = PHI_O; n < MECHANICAL_STATES; n++) der[n] = 0.0;
  if (set_up != MOTOR_ALONE) {
    shaft.tau_g = mesh_torque(x[PHI] / N - x[PHI_O], x[W] / N - x[W_O]);
    const double m = 0.5 * (1.0 + tanh(shaft.tau_g * x[W] / P_0));
    tau = shaft.tau_g / N * (m / eta + (1.0 - m) * eta) + tau_C_gear * sgn_w + d_gear * x[W];
  }
  if (set_up == LOADED) {
    shaft.tau_s = c_s * (x[PHI_O] - x[PHI_P]) + d_s * (x[W_O] - x[W_P]);
    shaft.tau_belt = c_b * (r * x[PHI_P] - x[PHI_B]) + d_b * (r * x[W_P] - x[W_B]);
    der[PHI_P] = x[W_P];
    der[W_P] = (shaft.tau_s - r * shaft.tau_belt - u.tau_h * tanh(x[W_P] / w_h)) / J_p;
    der[PHI_B] = x[W_B];
    der[W_B] = (shaft.tau_belt - (x[TAU_M] + tau_off) * tanh(x[W_B] / w_b0) - d_off * x[W_B]) / J_b;
    der[TAU_M] = omega_m * (brake_curve(u.i_b) - x[TAU_M]);
  }
  if (set_up != MOTOR_ALONE) {
    der[PHI_O] = x[W_O];
    der[W_O] = (shaft.tau_g - shaft.tau_s) / J_o;
  }
  der[PHI] = x[W];
  der[W] = (tau_e - tau_C_motor * sgn_w - d_motor * x[W] - tau) / J;
  return shaft;
}

/* Row at share s of the way from u to the next row. */
static inline inputs interpolate(const inputs *u, double s) {
  return (inputs){u[0].v + s * (u[1].v - u[0].v), u[0].i_b + s * (u[1].i_b - u[0].i_b),
                  u[0].tau_h + s * (u[1].tau_h - u[0].tau_h)};
}

#endif
