/* The pulse width modulation as it switches: the terminals of the DC equivalent are at v_dc or short-circuited.
 *
 *   v = v_dc sign(D)   while |t - t_n - T/2| < |D| T/2        t_n = t_0 + n T, t_0: the bridge has been switched on
 *   v = 0              for the rest of the period
 *   D = v_drive(t_n)/v_dc(t_n)                                held for the period: regular sampling
 *
 * That the pulse lies in the middle of its period is assumed: at the period's ends, in the middle of the time without
 * voltage, the ripple crosses the mean, and there the drive samples the current. Edges are time events, so that none moves with communication points.
 */
#ifndef COBOT_JOINT_SWITCHING_H
#define COBOT_JOINT_SWITCHING_H

#include "core/unit.h"

enum { IDLE = 0, BEFORE_PULSE, PULSE, AFTER_PULSE };
static const double PWM_PERIOD = 1 / 53.6e3, SHORTEST_PWM_PERIOD = 1e-7; /* s; ESCON 50/5; assumed */

static inline bool switching(const Unit *m) { return m->motor_level == SWITCHING; }

static inline double pwm_period(const Unit *m) {
  return m->pwm_T == 0 ? PWM_PERIOD : m->pwm_T > SHORTEST_PWM_PERIOD ? m->pwm_T : SHORTEST_PWM_PERIOD;
}

/* freewheeling through one switch and one diode */
static inline bool freewheels(const Unit *m) { return switching(m) && m->chopper[0] != PULSE; }

/* what is at the terminals where the drive asks for v; the diodes of the open bridge need no chopper */
static inline double chopped(Unit *m, double v) {
  m->v_drive = v;
  if (!m->enable) return v;
  return m->chopper[0] == PULSE ? copysign(m->v_dc, m->duty[0]) : 0;
}

/* the next edge, or begin of a period: t_0 + (n + share) T */
static double unit_next_time(const Unit *m) {
  if (!switching(m) || !m->enable) return INFINITY;
  double share = 1;
  switch (m->chopper[0]) {
    case IDLE: return -INFINITY;
    case BEFORE_PULSE: share = (1 - fabs(m->duty[0])) / 2; break;
    case PULSE: share = (1 + fabs(m->duty[0])) / 2; break;
    default: break;
  }
  return m->period[0] + (m->period[2] + share) * m->period[1];
}

static void unit_time_event(Unit *m) {
  if (m->chopper[0] == BEFORE_PULSE || m->chopper[0] == PULSE) {
    m->chopper[0]++;
    return;
  }
  const double T = pwm_period(m), last = m->period[1];
  if (m->chopper[0] == IDLE || T != last) { /* periods are counted from here */
    m->period[0] = m->chopper[0] == IDLE ? m->time : m->period[0] + (m->period[2] + 1) * last;
    m->period[1] = T;
    m->period[2] = 0;
  } else {
    m->period[2]++;
  }
  m->duty[0] = clamp(m->v_drive / m->v_dc, -1, 1);
  m->chopper[0] = BEFORE_PULSE;
}

#endif
