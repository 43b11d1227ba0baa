/* RODAS, a Rosenbrock method of order 4(3), L-stable and stiffly accurate, with an interpolant of order 3
 * (Hairer and Wanner 1996, "Solving Ordinary Differential Equations II", section IV.7 and table 7.3, the code RODAS):
 *
 *   (I/(gamma h) - J) k_i = f(t + alpha_i h, x + sum_j a_ij k_j) + sum_j c_ij/h k_j + h d_i df/dt
 */
#ifndef COSIM_RODAS_H
#define COSIM_RODAS_H

#include "monolithic/field_system.h"

typedef struct {
  FieldSystem *system;
  double J[MOST_STATES][MOST_STATES], f_t[MOST_STATES];
  Factors factors;
  bool linear; /* J and f_t are those of the present point */
  /* the step last tried: from t, x by h to y; x + s(..) inside of it */
  double t, h, x[MOST_STATES], f[MOST_STATES], y[MOST_STATES], k[6][MOST_STATES], c2[MOST_STATES], c3[MOST_STATES];
} Rodas;

/* One step of length h from t, x, f, which are set and where the units are: y, and the error over `tolerance` of what counts as much of each state;
 * infinite where there is no such step. */
double rodas_step(Rodas *r, double h, double tolerance);
/* between t and t + h of the step last made */
void rodas_between(const Rodas *r, double t, double x[]);

#endif
