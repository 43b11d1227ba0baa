/* Series elastic element; the table beside this file has every equation's source. */
#include "core/unit.h"

static void unit_start(Unit *m) { (void)m; }

static void unit_equations(Unit *m) {
  const double e = m->phi_o - m->phi_p, beyond = positive(fabs(e) - m->stop_e_max);
  m->e = e;
  m->at_stop = beyond > 0;
  m->tau_s = m->spring_c * e * (1 + m->stiffness_hardening_h * e * e) + m->spring_d * (m->w_o - m->w_p) +
             m->stop_c_stop * copysign(beyond, e);

  const double q = m->reading_counts > 0 ? 2 * PI / m->reading_counts : 0;
  m->tau_reading = m->reading_c_r * (q > 0 ? q * nearbyint(e / q) : e) + m->offset_tau_0 + m->y_add;
}
