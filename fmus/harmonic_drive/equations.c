/* Harmonic drive. The table beside this file has the sources of the terms; the base model:
 *
 *   N           = -z_f/2                                   thesis eq. 2.28, flex spline as output
 *   delta       = phi/N - phi_o                            wind-up, at the output
 *   tau_g       = T(delta) + d_g ddelta/dt                 thesis eq. 2.31, at the output
 *   tau         = tau_g/N + tau_f                          thesis eq. 2.29: what the wave generator takes from the motor
 *   J_o dw_o/dt = tau_g - tau_s                            thesis eq. 2.30
 */
#define UNIT_EVENTS
#include "core/unit.h"
#include "friction/friction.h"

enum { FROM_VALUE = 1, FROM_TEETH };
enum { FLEX_SPLINE = 1, CIRCULAR_SPLINE };

static void unit_start(Unit *m) {
  const double turns = m->ratio_z_f / 2.0; /* two teeth of difference */
  m->N[0] = m->ratio_from == FROM_VALUE ? m->ratio_N : m->ratio_output == FLEX_SPLINE ? -turns : turns + 1;
}

static inline double error_angle(const Unit *m) { return 2 * m->phi + m->kinematic_error_phi_0; }

/* ddelta/dphi, by which the input feels the flex spline */
static inline double input_share(const Unit *m) {
  return 1 / m->N[0] + (m->kinematic_error_A != 0 ? 2 * m->kinematic_error_A * cos(error_angle(m)) : 0);
}

static inline double wind_up(const Unit *m) {
  const double error = m->kinematic_error_A != 0 ? m->kinematic_error_A * sin(error_angle(m)) : 0;
  return m->phi / m->N[0] - m->phi_o + m->delta_add + error - m->slip[0];
}

/* three slopes; odd, and of the wind-up alone: what goes in comes out */
static inline double spring(const Unit *m, double delta) {
  const double T_1 = m->flex_spline_T_1, T_2 = fmax(T_1, m->flex_spline_T_2), e = fabs(delta);
  const double e_1 = T_1 / m->flex_spline_K_1, e_2 = e_1 + (T_2 - T_1) / m->flex_spline_K_2;
  const double T = e <= e_1   ? m->flex_spline_K_1 * e
                   : e <= e_2 ? T_1 + m->flex_spline_K_2 * (e - e_1)
                              : T_2 + m->flex_spline_K_3 * (e - e_2);
  return copysign(T, delta);
}

static void unit_equations(Unit *m) {
  const double delta = wind_up(m), rate = m->w * input_share(m) - m->w_o;
  double tau_g = spring(m, delta) + m->flex_spline_d_g * rate;

  m->der_z_h = 0;
  if (m->hysteresis_T_h != 0) {
    tau_g += m->hysteresis_T_h * m->z_h;
    m->der_z_h = (rate - fabs(rate) * m->z_h) / m->hysteresis_phi_h;
  }
  m->tau = tau_g * input_share(m) + friction(m, m->w, m->load_friction_mu * fabs(tau_g / m->N[0])) - m->tau_add;

  /* J_o dw_o/dt = tau_g - tau_s, eq. 2.30 */
  m->der_phi_o = m->w_o;
  m->der_w_o = (tau_g - m->tau_s + m->tau_o_add) / m->output_J_o;

  m->tau_g = tau_g;
  m->delta = delta;
  m->J_coupled = m->wave_generator_J_coupled;
}

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  const double over = m->ratcheting_x * spring(m, wind_up(m));
  z[EVENT_ratchet_front] = over - 1;
  z[EVENT_ratchet_back] = -over - 1;
}

/* one tooth, 2 pi/z_f = pi/|N|, until the teeth hold; never past the middle, so that a jump only loses energy */
static void unit_event(Unit *m, int event) {
  (void)event;
  const double tooth = 3.14159265358979323846 / fabs(m->N[0]);
  do {
    const double delta = wind_up(m);
    m->slip[0] += copysign(fmin(tooth, fabs(delta)), delta);
  } while (m->ratcheting_x * fabs(spring(m, wind_up(m))) >= 1);
}
