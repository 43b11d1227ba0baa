/* Planetary gearhead; the table beside this file has every equation's source. */
#define UNIT_EVENTS
#include "fmi2/unit.h"
#include "friction/friction.h"
#include "planetary_gear/ratio.h"

enum { GAP, FRONT, BACK, FRONT_SLACK, BACK_SLACK }; /* slack: flanks touch, but would have to pull */

static void unit_start(Unit *m) { m->N[0] = total_ratio(m); }

static inline double half_gap(const Unit *m) { return fmax(0, m->mesh_b + m->backlash_b_x) / 2; }

/* twist of the mesh and its rate, at the output */
static inline double twist(const Unit *m, double *rate) {
  double delta = m->phi / m->N[0] - m->phi_o + m->delta_add, ddelta = m->w / m->N[0] - m->w_o;
  if (m->transmission_error_A != 0) {
    const double n = m->transmission_error_n, angle = n * m->phi_o + m->transmission_error_phi_0;
    delta += m->transmission_error_A * sin(angle);
    ddelta += m->transmission_error_A * n * m->w_o * cos(angle);
  }
  *rate = ddelta;
  return delta;
}

/* contact force if the flanks touched with wind-up e, negative where they would have to pull */
static inline double contact(const Unit *m, double e, double rate) {
  return m->mesh_c * e * (1 + m->stiffness_hardening_h * e * e) + m->mesh_d_g * rate;
}

static void unit_equations(Unit *m) {
  const double N = m->N[0];
  double rate, tau_g = 0;
  const double delta = twist(m, &rate);
  if (m->contact[0] == FRONT)
    tau_g = contact(m, delta - half_gap(m), rate);
  else if (m->contact[0] == BACK)
    tau_g = contact(m, delta + half_gap(m), rate);

  /* tau = tau_g/N (m/eta + (1 - m) eta) + tau_f, eq. 2.26 in both directions of power */
  const double forward = (1 + tanh(tau_g * m->w / m->mesh_P_0)) / 2;
  double tau_f = friction(m, m->w);
  if (m->load_friction_mu != 0) tau_f += m->load_friction_mu * fabs(tau_g) / fabs(N) * friction_direction(m, m->w);
  m->tau = tau_g / N * (forward / m->mesh_eta + (1 - forward) * m->mesh_eta) + tau_f - m->tau_add;

  /* J_o dw_o/dt = tau_g - tau_s, eq. 2.30 */
  m->der_phi_o = m->w_o;
  m->der_w_o = (tau_g - m->tau_s + m->tau_o_add) / m->output_J_o;

  m->tau_g = tau_g;
  m->delta = delta;
  m->J_coupled = m->housing_J_coupled;
  m->der_W_in = m->tau * m->w;
  m->der_W_in_abs = fabs(m->der_W_in);
  m->der_W_out = m->tau_s * m->w_o;
  m->der_W_out_abs = fabs(m->der_W_out);
}

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  double rate;
  const double delta = twist(m, &rate), half = half_gap(m);
  for (int k = 0; k < N_EVENT; k++) z[k] = -1;
  if (isinf(m->N[0])) return; /* neutral: nothing meets */
  switch (m->contact[0]) {
    case GAP:
      z[EVENT_touch_front] = delta - half;
      z[EVENT_touch_back] = -half - delta;
      break;
    case FRONT:
      z[EVENT_leave] = half - delta;
      z[EVENT_pull] = -contact(m, delta - half, rate);
      break;
    case BACK:
      z[EVENT_leave] = delta + half;
      z[EVENT_pull] = contact(m, delta + half, rate);
      break;
    case FRONT_SLACK:
      z[EVENT_leave] = half - delta;
      z[EVENT_push] = contact(m, delta - half, rate);
      break;
    case BACK_SLACK:
      z[EVENT_leave] = delta + half;
      z[EVENT_push] = -contact(m, delta + half, rate);
      break;
  }
}

static void unit_event(Unit *m, int event) {
  const bool front = m->contact[0] == FRONT || m->contact[0] == FRONT_SLACK;
  if (event == EVENT_touch_front)
    m->contact[0] = FRONT;
  else if (event == EVENT_touch_back)
    m->contact[0] = BACK;
  else if (event == EVENT_leave)
    m->contact[0] = GAP;
  else if (event == EVENT_push)
    m->contact[0] = front ? FRONT : BACK;
  else
    m->contact[0] = front ? FRONT_SLACK : BACK_SLACK;
}
