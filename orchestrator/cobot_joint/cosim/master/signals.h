/* Signals as polynomials of the time since the present communication point. */
#ifndef COSIM_SIGNALS_H
#define COSIM_SIGNALS_H

typedef struct { /* p(s) = a[0] + a[1] s + a[2] s^2 + a[3] s^3 */
  double a[4];
} Polynomial;

typedef struct {          /* what is known of a signal when a step begins */
  double y, dy;           /* at the present point */
  double y_prev, dy_prev; /* one step before */
  double y_prev2;         /* two steps before */
} Past;

static inline double value(const Polynomial *p, double s) {
  return p->a[0] + s * (p->a[1] + s * (p->a[2] + s * p->a[3]));
}

/* the same polynomial, of the time since s */
static inline Polynomial shifted(const Polynomial *p, double s) {
  const double *a = p->a;
  return (Polynomial){{value(p, s), a[1] + s * (2 * a[2] + s * (3 * a[3])), a[2] + s * (3 * a[3]), a[3]}};
}

static inline Polynomial constant(double y) { return (Polynomial){{y, 0, 0, 0}}; }

static inline Polynomial line(double y0, double y1, double h) { return (Polynomial){{y0, (y1 - y0) / h, 0, 0}}; }

/* cubic Hermite: values and slopes at 0 and h */
static inline Polynomial hermite(double y0, double dy0, double y1, double dy1, double h) {
  double slope = (y1 - y0) / h;
  return (Polynomial){{y0, dy0, (3 * slope - 2 * dy0 - dy1) / h, (dy0 + dy1 - 2 * slope) / (h * h)}};
}

/* of p q from 0 to h, by four points of Gauss: exact for cubics */
static inline double integral(const Polynomial *p, const Polynomial *q, double h) {
  static const double at[] = {0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263};
  static const double weight[] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693};
  double mean = 0;
  for (int k = 0; k < 4; k++) mean += weight[k] * (value(p, at[k] * h) * value(q, at[k] * h));
  return mean * h;
}

/* Continues a signal whose unit gives its slope. `known`: points, the present one included; h_prev: the last step's length. */
static inline Polynomial extrapolate_with_slope(const Past *p, int degree, int known, double h_prev) {
  if (degree == 0) return constant(p->y);
  if (degree == 1 || known < 2) return (Polynomial){{p->y, p->dy, 0, 0}};
  double slope_prev = (p->y - p->y_prev) / h_prev;
  if (degree == 2) return (Polynomial){{p->y, p->dy, (p->dy - slope_prev) / h_prev, 0}};
  double a3 = (p->dy + p->dy_prev - 2 * slope_prev) / (h_prev * h_prev);
  return (Polynomial){{p->y, p->dy, (2 * p->dy + p->dy_prev - 3 * slope_prev) / h_prev, a3}};
}

/* The same from past values alone, by Newton's divided differences; at most quadratic. */
static inline Polynomial extrapolate_values(const Past *p, int degree, int known, double h_prev, double h_prev2) {
  if (degree == 0 || known < 2) return constant(p->y);
  double slope_prev = (p->y - p->y_prev) / h_prev;
  if (degree == 1 || known < 3) return (Polynomial){{p->y, slope_prev, 0, 0}};
  double slope_prev2 = (p->y_prev - p->y_prev2) / h_prev2;
  double a2 = (slope_prev - slope_prev2) / (h_prev + h_prev2);
  return (Polynomial){{p->y, slope_prev + a2 * h_prev, a2, 0}};
}

#endif
