/* Position loop; the table beside this file has every equation's source. */
#define UNIT_EVENTS
#include "core/unit.h"

static double position_error(const Unit *m) { return m->phi_ref - m->phi + (m->s_ref - m->s) / m->gains_lead; }
static double measured_speed(const Unit *m) { return m->w + m->v / m->gains_lead; }
static double filtered_speed(const Unit *m) { return m->velocity_filter_T > 0 ? m->x_w : measured_speed(m); }

/* e_w = k_p e + x_p + k_ff w_ref - k_w w_f */
static double speed_error(const Unit *m) {
  const double wanted = m->gains_k_p * position_error(m) + m->feedforward_k_ff * m->w_ref;
  return wanted + (m->integrator_k_i != 0 ? m->x_p : 0) - m->gains_k_w * filtered_speed(m);
}

/* u = u_pos + K (u_pos - tau_s/k_t), u_pos = k_v e_w + x_v */
static double wanted_voltage(const Unit *m) {
  const double u_pos = m->gains_k_v * speed_error(m) + (m->integrator_k_iv != 0 ? m->x_v : 0);
  return u_pos + m->torque_feedback_K * (u_pos - m->tau_s / m->torque_feedback_k_t);
}

static double saturated(const Unit *m, double u) { return clamp(u, -m->saturation_u_max, m->saturation_u_max); }

static double control(const Unit *m) { return saturated(m, wanted_voltage(m)) + m->u_add; }

/* back-calculation: what the saturation cuts off runs the integrators back */
static void integrate_errors(Unit *m) {
  const double u = wanted_voltage(m), back = (saturated(m, u) - u) / m->integrator_T_t, k_v = m->gains_k_v;
  m->der_x_p = m->integrator_k_i == 0 ? 0 : m->integrator_k_i * position_error(m) + (k_v != 0 ? back / k_v : 0);
  m->der_x_v = m->integrator_k_iv == 0 ? 0 : m->integrator_k_iv * speed_error(m) + back;
  if (m->enable) return;
  m->der_x_p = -m->x_p / m->integrator_T_t;
  m->der_x_v = -m->x_v / m->integrator_T_t;
}

/* n*T_s and a sum of steps differ by rounding */
static bool sample_is_due(const Unit *m) { return m->time >= m->next_sample[0] - 1e-9 * m->sampling_T_s; }

static void unit_start(Unit *m) { (void)m; }

static void unit_equations(Unit *m) {
  const bool held = m->sampling_T_s > 0 && !sample_is_due(m);
  const double u = held ? m->held[0] : control(m);
  m->u_c = m->enable ? u * m->v_supply / m->saturation_v_nominal : 0;
  m->tau = m->drive_k_tau * m->u_c;
  m->e_phi = position_error(m);
  m->w_f = filtered_speed(m);
  integrate_errors(m);
  m->der_x_w = m->velocity_filter_T > 0 ? (measured_speed(m) - m->x_w) / m->velocity_filter_T : 0;
}

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  z[EVENT_sample] = m->sampling_T_s > 0 && sample_is_due(m) ? 1 : -1;
}

static void unit_event(Unit *m, int event) {
  (void)event;
  m->held[0] = control(m);
  m->next_sample[0] = (floor(m->time / m->sampling_T_s + 1e-6) + 1) * m->sampling_T_s;
}
