/* The axis of axis.py, Euler at the recording's step:
 *
 *   J dw/dt = k u + tau - (tau_C + tau_A s + tau_S exp(-(w/w_S)^2)) s - d w - c w |w| - A sin(n phi + phi_0),  s = tanh(w/0.5)
 *   dphi/dt = w
 */
#include <math.h>
#include <stddef.h>

typedef struct {
  double J, k, d, tau_C, c, tau_A, A, n, phi_0, tau_S, w_S;
} Parameters;

/* Rows i to end of out: phi, w. x: both at row i, then at `end`. from: rows at which A and c set in.
 * 0: |w| went above `fastest`. */
int axis(const Parameters *p, double step, double fastest, const size_t from[2], const double u[], const double tau[],
         size_t i, size_t end, double x[2], double out[]) {
  double phi = x[0], w = x[1];
  for (; i < end && fabs(w) <= fastest; i++) {
    out[2 * i] = phi;
    out[2 * i + 1] = w;
    const double s = tanh(w / 0.5), by_w = w / p->w_S;
    double friction = p->tau_C * s + p->d * w + p->tau_A * s * s;
    if (i >= from[1]) friction += p->c * w * fabs(w);
    if (p->tau_S != 0) friction += p->tau_S * exp(-by_w * by_w) * s;
    if (i >= from[0]) friction += p->A * sin(p->n * phi + p->phi_0);
    phi += step * w;
    w += step * (p->k * u[i] - friction + tau[i]) / p->J;
  }
  x[0] = phi;
  x[1] = w;
  return fabs(w) <= fastest;
}
