/* Driven load; the table beside this file has every equation's source. */
#include "fmi2/unit.h"
#include "friction/friction.h"

enum { TORQUE = 1, IMPOSED };

static void unit_start(Unit *m) { (void)m; }

static void unit_equations(Unit *m) {
  const double lead = m->body_lead, mass = m->body_m, r = m->body_r;
  const double w = m->motion_source == IMPOSED ? m->w_imposed : m->x_w;

  m->tau_g = mass * m->gravity_g * (r * sin(m->phi + m->gravity_phi_0) + lead * sin(m->gravity_slope));
  m->tau_f = friction(m, w, 0);
  if (m->viscous_asymmetry_d_A != 0) m->tau_f += fmax(m->viscous_asymmetry_d_A * copysign(1, w), -viscous(m, w)) * w;

  /* (J + J_variable + m (lead^2 + r^2)) dw/dt = tau + tau_add + lead F_add - tau_g - tau_f */
  const double J_log = fmax(m->J_variable, 0); /* continued by its derivative, an input may pass its bound */
  const double J = m->body_J + J_log + mass * (square(lead) + square(r));
  m->der_x_w = m->motion_source == IMPOSED ? 0 : (m->tau + m->tau_add + lead * m->F_add - m->tau_g - m->tau_f) / J;
  m->der_phi = w;
  m->der_W = m->tau * w;
  m->der_W_abs = fabs(m->der_W);

  m->w = w;
  m->v = m->der_s = lead * w;
}
