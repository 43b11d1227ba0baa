/* Friction of one shaft: the equations of friction.def. Positive torque resists positive speed. */
#ifndef COBOT_JOINT_FRICTION_H
#define COBOT_JOINT_FRICTION_H

#include "fmi2/unit.h"

/* what Coulomb friction follows: the sign of the speed, and for the share that bristles carry, their deflection */
static inline double friction_direction(const Unit *m, double w) {
  const double direction = sgn(w, m->friction_w_C);
  return direction + m->presliding_share * (m->z - direction);
}

static inline double friction(Unit *m, double w) {
  const double direction = sgn(w, m->friction_w_C);
  const double tau_C = m->friction_tau_C * friction_direction(m, w);
  double d = m->friction_d;
  double tau = 0;

  m->der_z = 0;
  if (m->stribeck_tau_S != 0) tau += m->stribeck_tau_S * exp(-square(w / m->stribeck_w_S)) * direction;
  if (m->sublinear_viscous_x != 0) d *= 1 - m->sublinear_viscous_x * fabs(w) / (m->sublinear_viscous_w_T + fabs(w));
  if (m->windage_c != 0) tau += m->windage_c * w * fabs(w);
  if (m->friction_asymmetry_tau_A != 0)
    tau += m->friction_asymmetry_tau_A * (direction + m->friction_asymmetry_m) * direction;
  if (m->viscous_warmup_fade != 0)
    d -= m->friction_d * m->viscous_warmup_fade * (1 - exp(-m->time / m->viscous_warmup_T));
  if (m->presliding_share != 0) m->der_z = (w - fabs(w) * m->z) / m->presliding_phi_s;
  return tau_C + d * w + tau;
}

#endif
