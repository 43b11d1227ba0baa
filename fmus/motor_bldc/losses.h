/* What bridge, supply and iron take, each off at zero. */
#ifndef COBOT_JOINT_LOSSES_H
#define COBOT_JOINT_LOSSES_H

#include "core/unit.h"
#include "motor_bldc/constants.h"
#include "motor_bldc/switching.h"

/* whether there is any: follows from the parameters, and is asked in every evaluation */
static inline bool any_loss(const Unit *m) {
  return m->mosfet_R_on != 0 || m->diode_drop_V_d != 0 || m->pwm_T != 0 || m->iron_loss_P != 0 || m->bus_C != 0;
}

/* voltage lost in the bridge: both active switches 2 R_on i; a diode V_d sgn(i) while the current freewheels, 1 - D of the
 * time, D = |v|/v_bus; chopped, v is 0 then, and one switch and one diode conduct */
static inline double bridge_drop(const Unit *m, double v, double i) {
  double drop = 0;
  if (m->mosfet_R_on != 0) drop += (freewheels(m) ? 1 : 2) * m->mosfet_R_on * i;
  if (m->diode_drop_V_d != 0)
    drop += m->diode_drop_V_d * positive(1 - fabs(v) / bus_voltage(m)) * sgn(i, m->diode_drop_i_0);
  return drop;
}

/* mean square of the ripple, a triangle of i_pp = v_bus D (1 - D) T/L from peak to peak: i_pp^2/12; chopped, the current has it */
static inline double ripple_square(const Unit *m, double v) {
  if (m->pwm_T == 0 || switching(m)) return 0;
  const double D = clamp(fabs(v) / bus_voltage(m), 0, 1);
  return square(bus_voltage(m) * D * (1 - D) * m->pwm_T / m->winding_L) / 12;
}

/* tau_Fe = P(w)/w, P of Bertotti: hysteresis with w, excess with w^1.5, eddy currents with w^2; P at w_0 */
static inline double iron_torque(const Unit *m) {
  if (m->iron_loss_P == 0) return 0;
  const double x = m->w / m->iron_loss_w_0, h = m->iron_loss_h, a = m->iron_loss_a;
  const double dry = (h + a * sqrt(fabs(x))) * sgn(m->w, m->friction_w_C);
  return m->iron_loss_P / m->iron_loss_w_0 * (dry + positive(1 - h - a) * x);
}

/* C d(surge)/dt = -p/v_dc - (v_dc - v_ch)/R_ch, v_dc = v_bus + surge; the supply holds v_bus and takes nothing back */
static inline double surge_rate(const Unit *m, double p) {
  if (m->bus_C == 0) return 0;
  const double v_dc = bus_voltage(m), over = positive(v_dc - m->bus_v_ch);
  const double rate = -(p / v_dc + (m->bus_R_ch > 0 ? over / m->bus_R_ch : 0)) / m->bus_C;
  return m->surge > 0 ? rate : positive(rate);
}

#endif
