/* What the winding's current and the rotor's speed make of each other. */
#ifndef COBOT_JOINT_CONSTANTS_H
#define COBOT_JOINT_CONSTANTS_H

#include "core/unit.h"

static inline double electrical_angle(const Unit *m) { return m->winding_p * m->phi; }

/* of the bridge's supply: where a capacitor takes what the motor gives back, it rises */
static inline double bus_voltage(const Unit *m) { return m->inverter_v_bus + (m->bus_C > 0 ? positive(m->surge) : 0); }

/* terminal voltage at which a diode conducts, against the middle of the supply */
static inline double diode_voltage(const Unit *m) { return bus_voltage(m) / 2 + m->diode_drop_V_d; }

/* torque over current: k (1 - beta (T_m - 25 degC)) (1 + A sin(n phi + phi_0))/(1 + s i^2) */
static inline double torque_constant(const Unit *m, double i) {
  double k = m->winding_k;
  if (m->magnet_beta != 0) k *= positive(1 - m->magnet_beta * (m->winding_heating_T_a + m->rise_m - 298.15));
  if (m->torque_ripple_A != 0) k *= 1 + m->torque_ripple_A * sin(m->torque_ripple_n * m->phi + m->torque_ripple_phi_0);
  if (m->torque_saturation_s != 0) k /= 1 + m->torque_saturation_s * square(i);
  return k;
}

/* back-EMF over speed: ripples as the torque does, by virtual work; the torque that saturation takes is lost while the
 * motor drives, and while it brakes the back-EMF falls with it, or the motor would make energy */
static inline double emf_constant(const Unit *m, double i, bool brakes) { return torque_constant(m, brakes ? i : 0); }

#endif
