/* Correction as data: y = x + table(u1) f2(u2) + sum over features of A f1(u1) f2(u2) f3(u3) f4(u4), from `onset` on.
 * The table beside this file says where functions and numbers come from (Brunton, Proctor and Kutz 2016). */
#include "core/unit.h"

enum { FEATURES = 8, SIGNALS = 4 };
typedef enum { ONE = 1, U, U2, U3, ABS, TANH, SIN, COS, EXP, GAUSS, EDDY } Function;

static void unit_start(Unit *m) { (void)m; }

static double function(int f, double u, double p) {
  switch ((Function)f) {
    case ONE: return 1;
    case U: return u;
    case U2: return u * u;
    case U3: return u * u * u;
    case ABS: return fabs(u);
    case TANH: return tanh(u / p);
    case SIN: return sin(p * u);
    case COS: return cos(p * u);
    case EXP: return exp(-fabs(u) / p);
    case GAUSS: return exp(-square(u / p));
    case EDDY: return u / p / (1 + square(u / p));
  }
  return 1;
}

/* through (x[0], y[0]) to (x[n-1], y[n-1]), linear between, held outside */
static double interpolate(const double x[], const double y[], int n, double u) {
  if (u <= x[0]) return y[0];
  if (u >= x[n - 1]) return y[n - 1];
  int low = 0, high = n - 1;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    if (x[middle] <= u)
      low = middle;
    else
      high = middle;
  }
  return y[low] + (y[high] - y[low]) * (u - x[low]) / (x[high] - x[low]);
}

static void unit_equations(Unit *m) {
  m->y = m->x;
  if (m->time < m->onset_t) return;

  double u[SIGNALS] = {m->u1, m->u2, m->u3, m->u4};
  if (m->clock_u > 1) u[m->clock_u - 2] = m->time; /* choices count from 1, the first is none */
  if (m->table_n > 0) {
    const double *x = reals(m) + VR_table_x11, *y = reals(m) + VR_table_y11;
    const double period = m->table_period;
    const double at = period > 0 ? u[0] - period * floor((u[0] - x[0]) / period) : u[0];
    m->y += interpolate(x, y, m->table_n, at) * function(m->table_f2, u[1], m->table_p2);
  }

  for (int k = 0; k < FEATURES; k++) {
    const double *A = reals(m) + VR_feature1_A + k * (1 + SIGNALS),
                 *p = A + 1; /* A, p1 to p4 per feature, in the table's order */
    const int *f = integers(m) + VR_feature1_f1 + k * SIGNALS;
    if (*A == 0) continue;
    double product = *A;
    for (int j = 0; j < SIGNALS; j++) product *= function(f[j], u[j], p[j]);
    m->y += product;
  }
}
