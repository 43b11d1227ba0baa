/* Field-oriented control of the motor with sinusoidal back-EMFs, in rotor coordinates.
 *
 * Amplitudes of the phases, L_d = L_q = L_s, w_e = p w (MathWorks, PMSM HDL; torque: PMSM Torque Estimator):
 *
 *   L_s di_q/dt = v_q - R_s i_q - w_e L_s i_d - w_e psi
 *   L_s di_d/dt = v_d - R_s i_d + w_e L_s i_q
 *   tau_e       = 3/2 p psi i_q
 *
 * The table has R, L, k between two terminals: R_s = R/2, L_s = L/2. Which i = a i_q and v = b v_q are those of the DC
 * equivalent? The same power, v i = 3/2 v_q i_q, asks for a b = 3/2, and the same current at standstill, v = R i where
 * v_q = R/2 i_q, for b = 2 a. So a = sqrt(3)/2 and b = sqrt(3): v is the amplitude between two terminals. With the same
 * torque, k i = 3/2 p psi i_q, k = sqrt(3) p psi, and k w is the back-EMF's amplitude between two terminals. Then, with
 * the d axis in the same units:
 *
 *   L di/dt   = v - R i - (k w + w_e L i_d)      thesis eq. 2.5, and what the d axis adds
 *   L di_d/dt = v_d - R i_d + w_e L i
 *
 * Space-vector modulation gives a phase up to v_dc/sqrt(3) (SimpleFOC, PWM Modulation Strategies): v^2 + v_d^2 <= v_dc^2.
 */
#ifndef COBOT_JOINT_FOC_H
#define COBOT_JOINT_FOC_H

#include "core/unit.h"
#include "motor_bldc/constants.h"
#include "motor_bldc/drive.h"

/* voltage lost in two switches between two terminals, as on q */
static inline double d_drop(const Unit *m) { return m->enable ? 2 * m->mosfet_R_on * m->x_d : 0; }

/* L di_d/dt = v_d - R i_d - e_d, with i_d held at zero. In: the largest voltage, and q's k w; out: what the d axis, served
 * first (MathWorks, d-q Voltage Limiter), leaves of the one and adds to the other. */
static inline void d_axis(Unit *m, double i, double R, double *v_max, double *e_q) {
  const double w_e = m->winding_p * m->w, L = m->winding_L, i_d = m->x_d, e_d = -w_e * L * i;
  double v_d = e_d; /* keeps the d current at zero while the bridge is off */
  m->der_q_d = 0;
  if (m->enable) v_d = current_loop(m, 0 - i_d, m->q_d, e_d, *v_max, &m->der_q_d);
  *v_max = sqrt(positive(square(*v_max) - square(v_d)));
  *e_q += w_e * L * i_d;
  m->v_d = v_d - d_drop(m);
  m->der_x_d = (m->v_d - R * i_d - e_d) / L;
}

/* from two axes that stand still to three phases (Clarke) */
static inline void phases_of(double alpha, double beta, double *a, double *b, double *c) {
  *a = alpha;
  *b = -alpha / 2 + sqrt(3) / 2 * beta;
  *c = -alpha / 2 - sqrt(3) / 2 * beta;
}

/* e_a = e/sqrt(3) sin(theta_e), zero where the trapezoid is; the q axis is in phase with the back-EMF (Park) */
static inline void sinusoids(Unit *m, double i_q, double e) {
  const double s = sin(electrical_angle(m)), c = cos(electrical_angle(m)), i_d = m->x_d;
  const double i_ph = 2 / sqrt(3), e_ph = e / sqrt(3);
  phases_of(i_ph * (i_q * s - i_d * c), i_ph * (-i_q * c - i_d * s), &m->i_a, &m->i_b, &m->i_c);
  phases_of(e_ph * s, -e_ph * c, &m->e_a, &m->e_b, &m->e_c);
}

#endif
