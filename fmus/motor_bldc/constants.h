/* What the winding's current and the rotor's speed make of each other. */
#ifndef COBOT_JOINT_CONSTANTS_H
#define COBOT_JOINT_CONSTANTS_H

#include "fmi2/unit.h"

/* torque over current: k (1 + A sin(n phi + phi_0))/(1 + s i^2) */
static inline double torque_constant(const Unit *m, double i) {
  double k = m->winding_k;
  if (m->torque_ripple_A != 0) k *= 1 + m->torque_ripple_A * sin(m->torque_ripple_n * m->phi + m->torque_ripple_phi_0);
  if (m->torque_saturation_s != 0) k /= 1 + m->torque_saturation_s * square(i);
  return k;
}

/* back-EMF over speed: ripples as the torque does, by virtual work; the torque that saturation takes is lost while the
 * motor drives, and while it brakes the back-EMF falls with it, or the motor would make energy */
static inline double emf_constant(const Unit *m, double i, bool brakes) { return torque_constant(m, brakes ? i : 0); }

#endif
