/* Cycloidal drive. The table beside this file has the sources of the terms; the base model:
 *
 *   N           = -L/(P - L)                               thesis eq. 2.32
 *   delta       = phi/N - phi_o                            wind-up, at the output
 *   tau_g       = T(delta) + d_g ddelta/dt                 at the output
 *   tau         = tau_g/N + tau_f                          what the eccentric takes from the motor
 *   J_o dw_o/dt = tau_g - tau_s                            thesis eq. 2.30
 */
#include "core/unit.h"
#include "friction/friction.h"

enum { FROM_VALUE = 1, FROM_PINS };

/* not finite where the disc fills the ring; the initialization refuses */
static void unit_start(Unit *m) {
  const double P = m->ratio_P, L = m->ratio_L;
  m->N[0] = m->ratio_from == FROM_VALUE ? m->ratio_N : P > L ? -L / (P - L) : NAN;
}

static inline double error_angle(const Unit *m) { return m->angle_error_n * m->phi + m->angle_error_phi_0; }

/* soft up to T_1; odd, and of the wind-up alone: what goes in comes out */
static inline double spring(const Unit *m, double delta) {
  const double soft = m->mesh_T_1 / m->mesh_K_1, e = fabs(delta);
  return copysign(e <= soft ? m->mesh_K_1 * e : m->mesh_T_1 + m->mesh_K_2 * (e - soft), delta);
}

static void unit_equations(Unit *m) {
  const double A = m->angle_error_A, N = m->N[0];
  double delta = m->phi / N - m->phi_o + m->delta_add, share = 1 / N; /* share: ddelta/dphi */
  if (A != 0) {
    delta += A * sin(error_angle(m));
    share += A * m->angle_error_n * cos(error_angle(m));
  }
  const double tau_g = spring(m, delta) + m->mesh_d_g * (m->w * share - m->w_o);
  m->tau = tau_g * share + friction(m, m->w, m->load_friction_mu * fabs(tau_g / N)) - m->tau_add;

  /* J_o dw_o/dt = tau_g - tau_s, eq. 2.30 */
  m->der_phi_o = m->w_o;
  m->der_w_o = (tau_g - m->tau_s + m->tau_o_add) / m->output_J_o;

  m->tau_g = tau_g;
  m->delta = delta;
  m->J_coupled = m->eccentric_J_coupled;
}
