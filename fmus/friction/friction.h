/* Friction of one shaft. Positive torque resists positive speed. Symbols, titles and sources as in friction.def:
 *
 *   tau_f = tau_C sgn(w, w_C) + d w                        thesis eq. 4.2, 4.3
 *     stribeck            + tau_S exp(-(w/w_S)^2) sgn       Armstrong-Helouvry, Dupont and Canudas de Wit 1994
 *     sublinear_viscous   d times 1 - x |w|/(w_T + |w|)     Cross 1965, for a grease
 *     windage             + c w |w|                         White, Fluid Mechanics
 *     friction_asymmetry  + tau_A (sgn + m) sgn             Armstrong-Helouvry, Dupont and Canudas de Wit 1994
 *     viscous_warmup      d times 1 - fade (1 - exp(-t/T))  form assumed
 *     presliding          a share of tau_C follows the deflection z of bristles in place of sgn: Dahl 1968
 */
#ifndef COBOT_JOINT_FRICTION_H
#define COBOT_JOINT_FRICTION_H

#include "core/unit.h"
#include "friction/stick.h"

/* viscous friction over speed: cold grease at rest has d, shear and warmth each leave a share of it */
static inline double viscous(const Unit *m, double w) {
  double d = m->friction_d;
  if (m->sublinear_viscous_x != 0) d *= 1 - m->sublinear_viscous_x * fabs(w) / (m->sublinear_viscous_w_T + fabs(w));
  if (m->viscous_warmup_fade != 0)
    d *= 1 - m->viscous_warmup_fade * (1 - exp(-(m->time - m->start_time) / m->viscous_warmup_T));
  return d;
}

/* Coulomb friction of what slides at w in a direction; never drives */
static inline double sliding_friction(const Unit *m, double w, double direction, double tau_C) {
  double sliding = (1 - m->presliding_share) * tau_C;
  if (m->stribeck_tau_S != 0) sliding += m->stribeck_tau_S * exp(-square(w / m->stribeck_w_S));
  if (m->friction_asymmetry_tau_A != 0) sliding += m->friction_asymmetry_tau_A * (direction + m->friction_asymmetry_m);
  return positive(sliding);
}

/* whether anything depends on the direction */
static inline bool has_dry_friction(const Unit *m, double tau_C) {
  return tau_C != 0 || m->stribeck_tau_S != 0 || m->friction_asymmetry_tau_A != 0;
}

#ifdef FRICTION_STICKS
static inline bool sticks(const Unit *m) { return m->friction_law == STICK; }
static inline bool held_by_friction(const Unit *m) { return sticks(m) && m->sliding[0] == 0; }
static inline void start_sliding(Unit *m, double w) {
  m->sliding[0] = sliding_of(w, m->sliding[0], m->time == m->start_time);
}
/* applied: torque on the shaft but for friction that slides */
static inline void stick_indicators(const Unit *m, double w, double applied, double z[N_EVENT]) {
  if (!sticks(m)) return;
  z[EVENT_comes_to_rest] = comes_to_rest(m->sliding[0], w);
  z[EVENT_breaks_away] =
      breaks_away(m->sliding[0], applied, sliding_friction(m, 0, copysign(1, applied), m->friction_tau_C));
}
#endif

/* tau_load: what the load adds to the Coulomb friction */
static inline double friction(Unit *m, double w, double tau_load) {
  const double share = m->presliding_share, tau_C = m->friction_tau_C + tau_load;
  double direction = has_dry_friction(m, tau_C) ? sgn(w, m->friction_w_C) : 0;
#ifdef FRICTION_STICKS
  if (sticks(m)) direction = m->sliding[0];
#endif
  double tau = sliding_friction(m, w, direction, tau_C) * direction + viscous(m, w) * w;
  if (m->windage_c != 0) tau += m->windage_c * w * fabs(w);

  /* bristles keep the energy phi_s z^2/2: tau w = d/dt(phi_s z^2/2) + |w| z^2, also where the load changes tau_C */
  m->der_z = 0;
  if (share != 0) {
    const double root = sqrt(share * tau_C);
    tau += root * m->z;
    m->der_z = (root * w - fabs(w) * m->z) / m->presliding_phi_s;
  }
  return tau;
}

#endif
