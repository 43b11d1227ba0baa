/* Belt and MR brake. The table beside this file has the sources of the terms; the base model, thesis 3.1:
 *
 *   tau_belt    = c_b (r phi_p - phi_b) + d_b (r w_p - w_b)                at the brake shaft
 *   J_p dw_p/dt = tau_s - r tau_belt - tau_h sgn(w_p, w_h)                 tau_h: a hand that holds
 *   dtau_m/dt   = omega_m (f(i_b) - tau_m)                                 f: k_b |i|, saturating from tau_lin to tau_max
 *   J_b dw_b/dt = tau_belt - (tau_m + tau_off) sgn(w_b, w_b0) - d_off w_b
 *
 * Beside it, off at zero (L, i_h, 1/tau_0, A):
 *
 *   L di/dt     = v - R i, |v| <= v_s                                      the coil; i_b is what its driver is asked for
 *   T_e di_m/dt = e - clamp(e, +-i_h), e = i - i_m                         play: f(i_m) in place of f(i), remanence f(i_h)
 *   tau_belt    = tau_0 + c_b/2 (e_b - tau_0/c_b) beyond tau_0             one strand slack, the other of half the stiffness
 *   phi_belt    = r phi_p + A sin(z phi_p + phi_0)                         tooth mesh; dphi_belt/dphi_p instead of r
 */
#define UNIT_EVENTS
#include "core/unit.h"
#include "friction/stick.h"

/* external torque: whether it acts at the present time */
static inline bool touched_now(const Unit *m) {
  const double since = m->time - m->external_torque_t_0;
  return since >= 0 && since < m->external_torque_T_d;
}

static void unit_start(Unit *m) {
  const bool begins = m->time == m->start_time;
  m->touched[0] = touched_now(m);
  m->slides_p[0] = sliding_of(m->w_p, m->slides_p[0], begins);
  m->slides_b[0] = sliding_of(m->w_b, m->slides_b[0], begins);
}

static inline bool is_held_by_hand(const Unit *m) { return m->hand_law == STICK && m->slides_p[0] == 0; }
static inline bool is_held_by_brake(const Unit *m) { return m->brake_law == STICK && m->slides_b[0] == 0; }

/* torque of the brake: what slides, and the most that it holds */
static inline double brake_torque(const Unit *m) {
  return (m->brake_fade_x != 0 ? m->tau_m / (1 + m->brake_fade_x * m->E) : m->tau_m) + m->brake_tau_off;
}

/* f(i): linear up to tau_lin, saturating at tau_max */
static inline double brake_curve(const Unit *m, double i) {
  const double linear = m->brake_k_b * fabs(i), h = m->brake_tau_max - m->brake_tau_lin;
  if (linear <= m->brake_tau_lin) return linear;
  return h > 0 ? m->brake_tau_lin + h * (1 - exp(-(linear - m->brake_tau_lin) / h)) : m->brake_tau_max;
}

/* dphi_belt/dphi_p, by which the belt's speed follows the pulley's, and by virtual work the pulley feels the belt */
static inline double ratio(const Unit *m) {
  const double A = m->pulley_eccentricity_A, z = m->belt_mesh_z;
  double r = m->belt_r;
  if (A != 0) r *= 1 + A * cos(m->phi_p + m->pulley_eccentricity_phi_0);
  if (m->belt_mesh_A != 0) r += m->belt_mesh_A * z * cos(z * m->phi_p + m->belt_mesh_phi_0);
  return r;
}

/* phi_belt: angle that the large pulley gives to the belt, at the brake shaft */
static inline double belt_angle(const Unit *m) {
  double way = m->belt_r * m->phi_p;
  if (m->pulley_eccentricity_A != 0) {
    const double phi_0 = m->pulley_eccentricity_phi_0;
    way += m->belt_r * m->pulley_eccentricity_A * (sin(m->phi_p + phi_0) - sin(phi_0));
  }
  if (m->belt_mesh_A != 0)
    way += m->belt_mesh_A * (sin(m->belt_mesh_z * m->phi_p + m->belt_mesh_phi_0) - sin(m->belt_mesh_phi_0));
  return way;
}

/* T(e): both strands, and beyond the pretension the tight one alone */
static inline double strands(const Unit *m, double e) {
  const double tau = m->belt_c_b * e;
  if (m->belt_tension_x == 0 || fabs(tau) * m->belt_tension_x <= 1) return tau;
  return (tau + copysign(1 / m->belt_tension_x, tau)) / 2;
}

/* i: what the driver gives, or what flows behind an inductance */
static inline double coil(Unit *m) {
  const double i_ref = clamp(m->i_b, -m->driver_i_max, m->driver_i_max), L = m->coil_L, v_s = m->coil_v_s;
  if (L > 0) {
    const double v = clamp(m->coil_R * i_ref + m->coil_omega_i * L * (i_ref - m->x_coil), -v_s, v_s);
    m->der_x_coil = (v - m->coil_R * m->x_coil) / L;
    return m->x_coil;
  }
  const bool lag = m->driver_T > 0;
  m->der_x_coil = lag ? (i_ref - m->x_coil) / m->driver_T : 0;
  return lag ? m->x_coil : i_ref;
}

/* i_m: play between current and field */
static inline double magnetizing_current(Unit *m) {
  const double i_h = m->remanence_i_h, e = m->i_coil - m->i_m;
  m->der_i_m = i_h > 0 ? (e - clamp(e, -i_h, i_h)) / m->remanence_T_e : 0;
  return i_h > 0 ? m->i_m : m->i_coil;
}

/* torque on the pulley, the hand's apart */
static inline double on_the_pulley(const Unit *m) {
  double tau_p = m->tau_s - ratio(m) * m->tau_belt + m->tau_add;
  if (m->imbalance_G != 0) tau_p -= m->imbalance_G * sin(m->phi_p + m->imbalance_phi_0);
  if (m->position_friction_T != 0)
    tau_p -= m->position_friction_T *
             (m->position_friction_m + sin(m->position_friction_n * m->phi_p + m->position_friction_phi_0)) *
             sgn(m->w_p, m->position_friction_w_0);
  if (m->touched[0]) tau_p += m->external_torque_T;
  return tau_p;
}

/* torque on the brake's shaft, the field's and what it has without current apart */
static inline double on_the_brake(const Unit *m) {
  return m->tau_belt + m->tau_b_add - (m->brake_hysteresis_T != 0 ? m->brake_hysteresis_T * m->z_h : 0);
}

static void unit_equations(Unit *m) {
  const double w_p = m->w_p, w_b = m->w_b;

  m->i_coil = coil(m);

  /* belt: tau_belt = c_b (r phi_p - phi_b - slip) + d_b (r w_p - w_b - x tau_belt |r w_p|) */
  const double r = ratio(m);
  const double x = m->belt_creep_x * fabs(r * w_p); /* creep is a share of the belt's speed */
  const double tau_belt =
      (strands(m, belt_angle(m) - m->phi_b - m->slip + m->stretch_add) + m->belt_d_b * (r * w_p - w_b)) /
      (1 + m->belt_d_b * x);
  m->der_slip = x * tau_belt;
  m->tau_belt = tau_belt;

  /* J_p dw_p/dt = tau_s - r tau_belt - tau_h sgn(w_p, w_h) */
  double tau_p = on_the_pulley(m);
  if (m->tau_h > 0) tau_p -= m->tau_h * (m->hand_law == STICK ? m->slides_p[0] : sgn(w_p, m->hand_w_h));
  m->der_w_p = is_held_by_hand(m) ? 0 : tau_p / m->pulley_J_p;
  m->der_phi_p = w_p;

  /* dtau_m/dt = omega_m (f(i) - tau_m) */
  const double missing = brake_curve(m, magnetizing_current(m)) - m->tau_m;
  m->der_tau_m = m->brake_omega_m * (missing < 0 ? 1 - m->brake_release_lag_x : 1) * missing;

  /* J_b dw_b/dt = tau_belt - (tau_m + tau_off) sgn(w_b, w_b0) - d_off w_b */
  const double direction = m->brake_law == STICK ? m->slides_b[0] : sgn(w_b, m->brake_w_b0);
  double tau_b = tau_belt - brake_torque(m) * direction - m->brake_d_off * w_b + m->tau_b_add;
  m->der_z_h = 0;
  if (m->brake_hysteresis_T != 0) {
    m->der_z_h = (w_b - fabs(w_b) * m->z_h) / m->brake_hysteresis_phi_h;
    tau_b -= m->brake_hysteresis_T * m->z_h;
  }
  m->der_w_b = is_held_by_brake(m) ? 0 : tau_b / m->brake_J_b;
  m->der_phi_b = w_b;
  const double coil_heat = m->coil_L > 0 ? m->coil_R * square(m->i_coil) : 0;
  m->der_E = fabs(m->tau_m * w_b) + coil_heat - m->E / m->brake_fade_T_c;
}

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  for (int k = 0; k < N_EVENT; k++) z[k] = -1;
  const bool changes = m->external_torque_T != 0 && touched_now(m) != (m->touched[0] != 0);
  if (changes) z[m->touched[0] ? EVENT_touch_end : EVENT_touch_begin] = 1;
  if (m->hand_law == STICK) {
    z[EVENT_hand_holds] = comes_to_rest(m->slides_p[0], m->w_p);
    z[EVENT_hand_slips] = breaks_away(m->slides_p[0], on_the_pulley(m), positive(m->tau_h));
  }
  if (m->brake_law == STICK) {
    z[EVENT_brake_holds] = comes_to_rest(m->slides_b[0], m->w_b);
    z[EVENT_brake_slips] = breaks_away(m->slides_b[0], on_the_brake(m), brake_torque(m));
  }
}

static void unit_event(Unit *m, int event) {
  switch (event) {
    case EVENT_hand_holds: m->w_p = m->slides_p[0] = 0; break;
    case EVENT_hand_slips: m->slides_p[0] = on_the_pulley(m) > 0 ? 1 : -1; break;
    case EVENT_brake_holds: m->w_b = m->slides_b[0] = 0; break;
    case EVENT_brake_slips: m->slides_b[0] = on_the_brake(m) > 0 ? 1 : -1; break;
    default: m->touched[0] = event == EVENT_touch_begin;
  }
}
