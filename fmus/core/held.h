/* Inputs that the master holds over a step, and how they go on within it all the same: docs/decisions/0012-held-inputs.md.
 * Where the master gives derivatives, these count, and nothing here does. */
#ifndef COBOT_JOINT_HELD_H
#define COBOT_JOINT_HELD_H

#include "core/integrate.h"

/* set anew at every step, without derivatives; a value that is set once stays as it is */
static inline bool is_held(const Unit *m, int j) { return m->u[j].fresh && m->u[j].streamed && !m->u[j].given; }

/* phi(t) = phi_k + w_k (t - t_k): an angle cannot stand still while its own speed does not */
static inline void continue_angle(Unit *m, int phi, int w) {
  const int j = phi - FIRST_INPUT, k = w - FIRST_INPUT;
  if (j < 0 || j >= N_INPUT || k < 0 || k >= N_INPUT || !is_held(m, j) || m->u[k].given) return;
  m->u[j].c[1] = reals(m)[w];
  m->u[j].order = 1;
}

/* tau(t) = tau_k + late c e_k + tau' s +- (C e(s) + D e'(s)),  s = t - t_k,  e(s) = phi(t) - phi_k - w_k s: the shaft's own
 * departure from uniform motion, by which the neighbour's spring will answer.  C = answer c,  D = 2 sqrt(C J).
 *   late c e_k   what the neighbour, who saw phi_{k-1} and w_{k-1}, does not know yet
 *   tau'         trend over the last step; it counts for less where the step is long for c on J */
static inline void continue_torque(Unit *m, int n, double J, double c, double late, double answer, double h) {
  const int j = HELD[n].tau - FIRST_INPUT;
  Anchor *q = &m->anchor[n];
  const double phi = reals(m)[HELD[n].phi], w = reals(m)[HELD[n].w], x = c * h * h / J, C = answer * c;
  if (!is_held(m, j) || !(c > 0) || x > 4) { /* beyond omega h = 2 a held spring is not stable, whatever is done */
    q->h = 0;
    return;
  }
  double tau = reals(m)[HELD[n].tau], trend = 0;
  if (q->h > 0) {
    tau += HELD[n].sign * late * c * (phi - q->phi - q->w * q->h);
    trend = (tau - q->tau) / q->h / (1 + 8 * x);
  }
  *q = (Anchor){.h = h, .t0 = m->time, .phi = phi, .w = w, .tau = tau, .C = C, .D = 2 * sqrt(C * J)};
  m->u[j].c[0] = tau;
  m->u[j].c[1] = trend;
  m->u[j].order = 1;
  m->u[j].answers = answer > 0;
}

static inline void continue_held(Unit *m, double h) {
  (void)m, (void)h; /* a unit may have neither row */
#define FLANGE(name, phi, w, tau, W, W_abs, role) continue_angle(m, VR_##phi, VR_##w);
#include "core/rows.h"
#define HELD_TORQUE(tau, phi, w, role, J, c, late, answer) continue_torque(m, HELD_##tau, m->J, m->c, late, answer, h);
#include "core/rows.h"
}

#endif
