/* Position loop; the table beside this file has every equation's source. */
#define UNIT_EVENTS
#include "fmi2/unit.h"

static double position_error(const Unit *m) { return m->phi_ref - m->phi + (m->s_ref - m->s) / m->gains_lead; }
static double measured_speed(const Unit *m) { return m->w + m->v / m->gains_lead; }
static double filtered_speed(const Unit *m) { return m->velocity_filter_T > 0 ? m->x_w : measured_speed(m); }

/* clamp(k_v (k_p e - k_w w_f), -u_max, u_max) + u_add */
static double control(const Unit *m) {
  const double u = m->gains_k_v * (m->gains_k_p * position_error(m) - m->gains_k_w * filtered_speed(m));
  return clamp(u, -m->saturation_u_max, m->saturation_u_max) + m->u_add;
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
