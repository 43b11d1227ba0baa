/* The drive: from set value and measurements to the voltage between the active terminals. */
#ifndef COBOT_JOINT_DRIVE_H
#define COBOT_JOINT_DRIVE_H

#include "core/unit.h"
#include "motor_bldc/constants.h"
#include "motor_bldc/open_bridge.h"

/* continuous limit once the heat above it, integral of i^2 - i_cont^2, has used up t_peak at i_peak */
static inline double current_limit(const Unit *m) {
  const double budget = (square(m->drive_i_peak) - square(m->drive_i_cont)) * m->drive_t_peak;
  return m->q_t < budget ? m->drive_i_peak : m->drive_i_cont;
}

/* 1 below the speed limit, falling to 0 within 2 % above it, for whatever accelerates */
static inline double speed_limit(const Unit *m, double accelerating) {
  if (m->drive_w_max == 0 || accelerating * m->w <= 0) return 1;
  return clamp((1.02 * m->drive_w_max - fabs(m->w)) / (0.02 * m->drive_w_max), 0, 1);
}

static inline double voltage_limit(const Unit *m, double v_dc) {
  return m->drive_v_max > 0 && m->drive_v_max < v_dc ? m->drive_v_max : v_dc;
}

/* PI of one current; no wind-up: what the limit takes away is taken back from the integral q, within L/R */
static inline double current_loop(const Unit *m, double error, double q, double e, double v_max, double *der_q) {
  const double v = m->drive_w_c * (m->winding_L * error + m->winding_R * q) + m->drive_decoupling * e;
  const double limited_v = clamp(v, -v_max, v_max);
  *der_q = error - (v - limited_v) / (m->drive_w_c * m->winding_L);
  return limited_v;
}

static inline double drive(Unit *m, double i, double e, double R, double v_max) {
  const bool limited = m->drive_i_peak > 0;
  double v;
  m->der_q_i = 0;
  m->der_q_t = limited && (m->q_t > 0 || fabs(i) > m->drive_i_cont) ? square(i) - square(m->drive_i_cont) : 0;
  if (!m->enable) return open_bridge_voltage(m, i, e);
  if (m->drive_mode == 1) {
    v = m->drive_k_v * m->set_value + m->drive_ixr * R * i;
    if (limited) { /* no more voltage above the back-EMF than drives the largest current through the winding */
      const double span = R * current_limit(m);
      v = clamp(v, e - span, e + span);
    }
    const double free = speed_limit(m, v - e);
    if (free < 1) v = e + free * (v - e);
    return clamp(v, -v_max, v_max);
  }
  double i_ref = m->drive_k_i * m->set_value;
  if (m->bias_i_0 != 0) i_ref += m->bias_i_0 * (m->bias_from == 1 ? sgn(m->w, m->bias_w_0) : sgn(i_ref, m->bias_i_s));
  i_ref *= speed_limit(m, i_ref);
  if (limited) i_ref = clamp(i_ref, -current_limit(m), current_limit(m));
  return current_loop(m, i_ref - i, m->q_i, e, v_max, &m->der_q_i);
}

#endif
