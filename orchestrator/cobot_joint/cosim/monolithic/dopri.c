/* DOPRI5, an explicit Runge-Kutta method of order 5(4) with an interpolant of order 4 (Dormand and Prince 1980, J. Comp. Appl.
 * Math. 6; interpolant: Hairer, Norsett and Wanner 1993, "Solving Ordinary Differential Equations I", section II.6):
 *
 *   k_i = f(t + c_i h, x + h sum_j a_ij k_j),   y = x + h sum_j a_7j k_j
 */
#include <math.h>

#include "monolithic/stepper.h"

enum { STAGES = 7 };
static const double AT[STAGES] = {0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1, 1};
static const double A[STAGES][STAGES - 1] = {{0},
                                             {1.0 / 5},
                                             {3.0 / 40, 9.0 / 40},
                                             {44.0 / 45, -56.0 / 15, 32.0 / 9},
                                             {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
                                             {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
                                             {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
static const double ERROR[STAGES] = {71.0 / 57600,      0,          -71.0 / 16695, 71.0 / 1920,
                                     -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
static const double INSIDE[STAGES] = {-12715105075.0 / 11282082432.0,  0,
                                      87487479700.0 / 32700410799.0,   -10690763975.0 / 1880347072.0,
                                      701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0,
                                      69997945.0 / 29380423.0};

static inline double sum(const Stepper *r, const double by[], int stages, size_t n) {
  double total = 0;
#pragma GCC unroll 7
  for (int j = 0; j < stages; j++) total += by[j] * r->k[j][n];
  return total;
}

double dopri_step(Stepper *r, double h, double tolerance) {
  FieldSystem *s = r->system;
  double e[MOST_STATES];
  r->h = h;
  r->there = false;
  for (size_t n = 0; n < s->n; n++) r->k[0][n] = r->f[n];
#pragma GCC unroll 7 /* known stages, so that states are summed side by side */
  for (int i = 1; i < STAGES; i++) {
    for (size_t n = 0; n < s->n; n++) r->y[n] = r->x[n] + h * sum(r, A[i], i, n);
    system_evaluate(s, r->t + AT[i] * h, r->y, r->k[i]);
  }
  for (size_t n = 0; n < s->n; n++) {
    const double d = r->y[n] - r->x[n];
    e[n] = h * sum(r, ERROR, STAGES, n);
    r->c2[n] = h * r->k[0][n] - d;
    r->c3[n] = d - h * r->k[STAGES - 1][n] - r->c2[n];
    r->c4[n] = h * sum(r, INSIDE, STAGES, n);
  }
  return norm(s, e, tolerance);
}
