/* One step of a system of ordinary differential equations, by one of two methods, with an interpolant inside of it. */
#ifndef COSIM_STEPPER_H
#define COSIM_STEPPER_H

#include "monolithic/field_system.h"

typedef struct {
  FieldSystem *system;
  double J[MOST_STATES][MOST_STATES], f_t[MOST_STATES];
  Factors factors;
  bool linear; /* J and f_t are those of the present point */
  bool there;  /* the units are at the present point */
  /* the step last tried: from t, x, where f is, by h to y; k: its stages; c2 to c4: of its interpolant */
  double t, h, x[MOST_STATES], f[MOST_STATES], y[MOST_STATES], k[7][MOST_STATES];
  double c2[MOST_STATES], c3[MOST_STATES], c4[MOST_STATES];
} Stepper;

enum { AT_END = 6 }; /* stage k where f at y is, once a step was taken */

/* A step of length h from t, x, f. Returns the error over `tolerance` of what counts as much of each state; infinite where
 * there is no such step. */
double rodas_step(Stepper *r, double h, double tolerance); /* however stiff the system is */
double dopri_step(Stepper *r, double h, double tolerance); /* at a third of the cost, for steps that are short anyway */

/* units at the present point, f theirs */
static inline void stay(Stepper *r) {
  r->system->since = r->t;
  if (!r->there) system_evaluate(r->system, r->t, r->x, r->f);
  r->there = true;
}

/* x at a time inside of the step last tried */
static inline void between(const Stepper *r, double t, double x[]) {
  const double s = (t - r->t) / r->h;
  for (size_t n = 0; n < r->system->n; n++)
    x[n] = r->x[n] + s * (r->y[n] - r->x[n] + (1 - s) * (r->c2[n] + s * (r->c3[n] + (1 - s) * r->c4[n])));
}

/* the largest of the errors e over the tolerance; infinite where one is no number */
static inline double norm(const FieldSystem *s, const double e[], double tolerance) {
  double worst = 0;
  for (size_t n = 0; n < s->n; n++) {
    const double r = fabs(e[n]) / s->nominal[n];
    if (!isfinite(r)) return INFINITY;
    worst = r > worst ? r : worst;
  }
  return worst / tolerance;
}

#endif
