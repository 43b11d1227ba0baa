/* Planetary gearhead. The table beside this file has the sources of the terms; the base model:
 *
 *   delta       = phi/N - phi_o                            wind-up, at the output
 *   tau_g       = c e + d_g de/dt, e = delta -+ b/2        while flanks touch, and never pulling; 0 in the gap b
 *   tau         = tau_g/N (m/eta + (1 - m) eta) + tau_f    thesis eq. 2.26, m: share of power that the motor drives
 *   J_o dw_o/dt = tau_g - tau_s                            thesis eq. 2.30
 *
 * Law stick: the same loss as dry friction where a speed is the unit's own, on the output shaft,
 *
 *   tau         = tau_g/N + tau_f
 *   J_o dw_o/dt = tau_g - tau_l sgn(w_o) - tau_s           tau_l = (1 - eta) |tau_g|   where tau_g drives the output
 *                                                                  (1/eta - 1) |tau_g| where it brakes it
 *
 * At constant speed that is eq. 2.26: tau_s = eta tau_g, or tau_g/eta. At rest tau_l holds whatever it can, so that the
 * output stays for eta tau_g <= tau_s <= tau_g/eta: at 75 % a load of 10 N.m for 7.5 to 13.3 N.m from the motor. tau_l
 * opposes w_o and makes no energy.
 */
#define UNIT_EVENTS
#include "core/unit.h"
#include "friction/friction.h"
#include "friction/stick.h"
#include "planetary_gear/ratio.h"

enum { GAP, FRONT, BACK, FRONT_SLACK, BACK_SLACK }; /* slack: flanks touch, but would have to pull */

static void unit_start(Unit *m) {
  m->N[0] = total_ratio(m);
  m->p_1[0] = -log(m->mesh_eta) / 2;
  mesh_orders(m, m->order);
  m->errs[0] =
      m->transmission_error_A != 0 || m->mesh_error_1_A != 0 || m->mesh_error_2_A != 0 || m->mesh_error_3_A != 0;
  m->sliding[0] = sliding_of(m->w_o, m->sliding[0], m->time == m->start_time);
}

static inline double half_gap(const Unit *m) { return fmax(0, m->mesh_b + m->backlash_b_x) / 2; }

/* angle error over the output angle, A sin(n phi_o + phi_0), added up, and its slope */
static inline double angle_error(const Unit *m, double *slope) {
  double error = *slope = 0;
  if (!m->errs[0]) return 0;
  const double A[4] = {m->transmission_error_A, m->mesh_error_1_A, m->mesh_error_2_A, m->mesh_error_3_A};
  const double n[4] = {m->transmission_error_n, m->order[0], m->order[1], m->order[2]};
  const double phi_0[4] = {m->transmission_error_phi_0, m->mesh_error_1_phi_0, m->mesh_error_2_phi_0,
                           m->mesh_error_3_phi_0};
  for (int k = 0; k < 4; k++) {
    if (A[k] == 0) continue;
    error += A[k] * sin(n[k] * m->phi_o + phi_0[k]);
    *slope += A[k] * n[k] * cos(n[k] * m->phi_o + phi_0[k]);
  }
  return error;
}

/* twist of the mesh and its rate, at the output */
static inline double twist(const Unit *m, double *rate) {
  double slope;
  const double error = angle_error(m, &slope);
  *rate = m->w / m->N[0] - m->w_o + slope * m->w_o;
  return m->phi / m->N[0] - m->phi_o + m->delta_add + error;
}

/* contact force if the flanks touched with wind-up e, negative where they would have to pull */
static inline double contact(const Unit *m, double e, double rate) {
  return m->mesh_c * e * (1 + m->stiffness_hardening_h * e * e) + m->mesh_d_g * rate;
}

/* dangle_o/dphi_o, by which the output feels the mesh: virtual work at an angle error over the output angle */
static inline double output_share(const Unit *m) {
  double slope;
  angle_error(m, &slope);
  return 1 - slope;
}

/* tau over tau_g/N: m/eta + (1 - m) eta, m = (1 + tanh(p))/2, p the power into the mesh; eq. 2.26 in both directions.
 * That gives power away for -p_1 < p < 0, tanh(p_1) = (1 - eta)/(1 + eta): there the mesh is ideal instead, and from
 * there on the loss rises to eq. 2.26 at p_1. A negative mu takes from the loss, at most all of it. */
static inline double over_ideal(const Unit *m, double tau_g) {
  if (tau_g == 0 || (m->mesh_eta == 1 && m->load_friction_mu >= 0)) return 1;
  const double eta = m->mesh_eta, p = copysign(1, m->N[0]) * tau_g * m->w / m->mesh_P_0, p_1 = m->p_1[0];
  const double forward = (1 + tanh_by_exp(p)) / 2, f = forward / eta + (1 - forward) * eta;
  double loss = p < 0 ? positive(1 - f) : p < p_1 ? (f - 1) * p / p_1 : f - 1;
  if (m->load_friction_mu < 0) loss = positive(loss + m->load_friction_mu * fabs(sgn(m->w, m->friction_w_C)));
  return p < 0 ? 1 - loss : 1 + loss;
}

static inline bool sticks(const Unit *m) { return m->mesh_law == STICK; }

/* torque on the output, the mesh's loss apart */
static inline double on_the_output(const Unit *m) { return m->tau_g * output_share(m) - m->tau_s + m->tau_o_add; }

/* tau_l: what the mesh keeps of its torque on an output that turns, or would turn, in a direction */
static inline double mesh_loss(const Unit *m, double direction) {
  const double tau = m->tau_g * output_share(m), eta = m->mesh_eta, less = fmin(0, m->load_friction_mu);
  const double driving = 1 + positive(1 / eta - 1 + less), braking = 1 - positive(1 - eta + less);
  return fabs(tau) * (tau * direction > 0 ? 1 - 1 / driving : 1 / braking - 1);
}

static void unit_equations(Unit *m) {
  const double N = m->N[0];
  double rate, tau_g = 0;
  const double delta = twist(m, &rate);
  if (m->contact[0] == FRONT)
    tau_g = contact(m, delta - half_gap(m), rate);
  else if (m->contact[0] == BACK)
    tau_g = contact(m, delta + half_gap(m), rate);

  const double tau_load = m->load_friction_mu > 0 ? m->load_friction_mu * fabs(tau_g / N) : 0;
  const double over = sticks(m) ? 1 : over_ideal(m, tau_g);
  m->tau = tau_g / N * over + friction(m, m->w, tau_load) - m->tau_add;
  m->tau_g = tau_g;

  /* J_o dw_o/dt = tau_g - tau_s, eq. 2.30 */
  const int sliding = m->sliding[0];
  m->der_phi_o = m->w_o;
  m->der_w_o = on_the_output(m) / m->output_J_o;
  if (sticks(m)) m->der_w_o = sliding ? (on_the_output(m) - sliding * mesh_loss(m, sliding)) / m->output_J_o : 0;

  m->delta = delta;
  m->J_coupled = m->housing_J_coupled;
}

static inline void contact_indicators(const Unit *m, double z[N_EVENT]) {
  double rate;
  const double delta = twist(m, &rate), half = half_gap(m);
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

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  for (int k = 0; k < N_EVENT; k++) z[k] = -1;
  contact_indicators(m, z);
  if (!sticks(m)) return;
  for (int k = 0; k < N_EVENT; k++)
    if (z[k] > 0) return; /* first the contact: what the mesh holds depends on it */
  const double applied = on_the_output(m);
  z[EVENT_comes_to_rest] = comes_to_rest(m->sliding[0], m->w_o);
  z[EVENT_breaks_away] = breaks_away(m->sliding[0], applied, mesh_loss(m, applied));
}

static void unit_event(Unit *m, int event) {
  const bool front = m->contact[0] == FRONT || m->contact[0] == FRONT_SLACK;
  if (event == EVENT_comes_to_rest)
    m->w_o = m->sliding[0] = 0;
  else if (event == EVENT_breaks_away)
    m->sliding[0] = on_the_output(m) > 0 ? 1 : -1;
  else if (event == EVENT_touch_front)
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
