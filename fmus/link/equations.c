/* Link; the table beside this file has every equation's source. */
#define UNIT_EVENTS
#include "core/unit.h"
#include "friction/friction.h"

static void unit_start(Unit *m) { start_sliding(m, m->w_p); }

static inline double wall(const Unit *m) {
  const double e = m->phi_p - m->wall_phi_c;
  return m->wall_k > 0 && e > 0 ? m->wall_k * e * positive(1 + m->wall_a * m->w_p) : 0;
}

/* torque on the link, friction that slides apart */
static inline double on_the_link(const Unit *m) {
  const double bristles = m->presliding_share != 0 ? sqrt(m->presliding_share * m->friction_tau_C) * m->z : 0;
  return m->tau_s + m->tau_add - m->tau_g - positive(m->tau_h) * sgn(m->w_p, m->hand_w_h) - m->tau_c - bristles;
}

static void unit_equations(Unit *m) {
  m->J = m->arm_J_l + m->arm_m * square(m->arm_r);
  m->tau_g = m->arm_m * m->arm_g * m->arm_r * sin(m->phi_p + m->arm_phi_0);
  if (m->imbalance_G != 0) m->tau_g += m->imbalance_G * sin(m->phi_p + m->imbalance_phi_0);
  m->tau_c = wall(m);
  const double hand = positive(m->tau_h) * sgn(m->w_p, m->hand_w_h), tau_f = friction(m, m->w_p, 0);

  m->der_w_p = held_by_friction(m) ? 0 : (m->tau_s + m->tau_add - m->tau_g - hand - m->tau_c - tau_f) / m->J;
  m->der_phi_p = m->w_p;
}

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  for (int k = 0; k < N_EVENT; k++) z[k] = -1;
  stick_indicators(m, m->w_p, on_the_link(m), z);
}

static void unit_event(Unit *m, int event) {
  m->sliding[0] = event == EVENT_comes_to_rest ? 0 : on_the_link(m) > 0 ? 1 : -1;
  if (event == EVENT_comes_to_rest) m->w_p = 0;
}
