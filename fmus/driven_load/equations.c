/* Driven load; the table beside this file has every equation's source. */
#define UNIT_EVENTS
#include "core/unit.h"
#include "friction/friction.h"

enum { TORQUE = 1, IMPOSED };

static inline double speed(const Unit *m) { return m->motion_source == IMPOSED ? m->w_imposed : m->x_w; }

static void unit_start(Unit *m) { start_sliding(m, speed(m)); }

/* torque on the shaft, friction that slides apart */
static inline double on_the_shaft(const Unit *m) {
  const double bristles = m->presliding_share != 0 ? sqrt(m->presliding_share * m->friction_tau_C) * m->z : 0;
  return m->tau + m->tau_add + m->body_lead * m->F_add - m->tau_g - bristles;
}

static void unit_equations(Unit *m) {
  const double lead = m->body_lead, mass = m->body_m, r = m->body_r;
  const double w = speed(m);

  const double slope = lead != 0 ? lead * sin(m->gravity_slope) : 0;
  m->tau_g = mass != 0 ? mass * m->gravity_g * (r * sin(m->phi + m->gravity_phi_0) + slope) : 0;
  if (m->imbalance_G != 0) m->tau_g += m->imbalance_G * sin(m->phi + m->imbalance_phi_0);
  m->tau_f = friction(m, w, 0);
  if (m->viscous_asymmetry_d_A != 0) m->tau_f += fmax(m->viscous_asymmetry_d_A * copysign(1, w), -viscous(m, w)) * w;

  /* (J + J_variable + m (lead^2 + r^2)) dw/dt = tau + tau_add + lead F_add - tau_g - tau_f */
  const double J_log = fmax(m->J_variable, 0); /* continued by its derivative, an input may pass its bound */
  const double J = m->body_J + J_log + mass * (square(lead) + square(r));
  const bool rests = m->motion_source == IMPOSED || held_by_friction(m);
  m->der_x_w = rests ? 0 : (m->tau + m->tau_add + lead * m->F_add - m->tau_g - m->tau_f) / J;
  m->der_phi = w;

  m->w = w;
  m->v = m->der_s = lead * w;
}

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  for (int k = 0; k < N_EVENT; k++) z[k] = -1;
  if (m->motion_source == IMPOSED) { /* which turns whatever friction does */
    if (sticks(m)) z[EVENT_breaks_away] = m->w_imposed * (m->w_imposed > 0 ? 1 - m->sliding[0] : -1 - m->sliding[0]);
    return;
  }
  stick_indicators(m, m->x_w, on_the_shaft(m), z);
}

static void unit_event(Unit *m, int event) {
  const bool imposed = m->motion_source == IMPOSED;
  m->sliding[0] = event == EVENT_comes_to_rest ? 0 : (imposed ? m->w_imposed : on_the_shaft(m)) > 0 ? 1 : -1;
  if (event == EVENT_comes_to_rest) m->x_w = 0;
}
