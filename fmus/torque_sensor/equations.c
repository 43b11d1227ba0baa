/* Torque sensor with amplifier. The table beside this file has the sources of the terms; the base model, thesis 3.1:
 *
 *   tau_s = c_s (phi_o - phi_p) + d_s (w_o - w_p)          the shaft
 *   applied = a reading + b                                its calibration, eq. 3.3
 *   y = reading v_rated/tau_rated, within +-v_max          the amplifier
 *
 * Between shaft and amplifier, off at zero (a_2, a_3, x, s, z), with DT = dT (1 - exp(-t/T_c)) for a sensor that warms up:
 *
 *   tau_b = (1 + s DT) (tau_s + a_2 tau_s^2/tau_rated + a_3 tau_s^3/tau_rated^2 + x tau_s cos(phi_p + phi_0)) + z DT
 */
#include "core/unit.h"

static void unit_start(Unit *m) { (void)m; }

/* tau_b: what the strain gauges show of the torque */
static inline double bridge(const Unit *m, double tau_s) {
  const double rated = m->amplifier_tau_rated;
  double tau = tau_s;
  if (m->quadratic_a != 0) tau += m->quadratic_a * square(tau_s) / rated;
  if (m->cubic_a != 0) tau += m->cubic_a * square(tau_s / rated) * tau_s;
  if (m->crosstalk_x != 0) tau += m->crosstalk_x * tau_s * cos(m->phi_p + m->crosstalk_phi_0);
  if (m->zero_drift_z == 0 && m->span_drift_s == 0) return tau;
  const double DT = m->warming_dT * (1 - exp(-(m->time - m->start_time) / m->warming_T_c));
  return (1 + m->span_drift_s * DT) * tau + m->zero_drift_z * DT;
}

static void unit_equations(Unit *m) {
  /* couplings in series with the shaft */
  const double c = m->shaft_c_s / (1 + m->shaft_c_s * (m->shaft_s_o + m->shaft_s_p));
  const double tau_s = c * (m->phi_o - m->phi_p) + m->shaft_d_s * (m->w_o - m->w_p);
  m->tau_s = tau_s;

  /* from here on the reading, not the shaft */
  const double tau_b = bridge(m, tau_s);
  double reading = tau_b;
  m->der_y_f = m->der_z_H = m->der_tau_f = 0;
  if (m->low_pass_T > 0) {
    m->der_y_f = (tau_b - m->y_f) / m->low_pass_T;
    const double x = m->low_pass_T_s / m->low_pass_T; /* lag T_s/(e^x - 1): T - T_s/2 for T >> T_s, 0 for T << T_s */
    reading = m->y_f + (x > 0 ? 1 - x / expm1(x) : 0) * (tau_b - m->y_f);
  }
  if (m->hysteresis_H != 0) { /* dtau_s/dt from a follower of 1 ms, since the torque has no derivative at hand */
    m->der_tau_f = (tau_s - m->tau_f) / 1e-3;
    m->der_z_H = (m->der_tau_f - fabs(m->der_tau_f) * m->z_H) / m->hysteresis_tau_H;
    reading += m->hysteresis_H * m->z_H;
  }
  if (m->misalignment_ripple_A != 0)
    reading += m->misalignment_ripple_A * sin(m->misalignment_ripple_n * m->phi_p + m->misalignment_ripple_phi_0);
  reading = (1 + m->gain_g) * reading + m->offset_tau_0;
  m->tau_reading = (reading - m->calibration_b) / m->calibration_a + m->y_add;

  const double v_max = m->amplifier_v_max;
  m->y = clamp(m->tau_reading * m->amplifier_v_rated / m->amplifier_tau_rated, -v_max, v_max);
  m->overload = fabs(tau_s) > m->amplifier_overload * m->amplifier_tau_rated;
}
