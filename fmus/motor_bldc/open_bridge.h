/* The bridge with all switches open: each leg is on the diode that its current needs, or open once the current is gone;
 * a back-EMF above the supply turns diodes on again. Legs: -1 on the ground's diode, 1 on the supply's, 0 open. */
#ifndef COBOT_JOINT_OPEN_BRIDGE_H
#define COBOT_JOINT_OPEN_BRIDGE_H

#include "core/unit.h"
#include "motor_bldc/constants.h"

/* a current into the motor comes from ground, a current out of it goes to the supply */
static inline int leg_of(double i) { return i > 0 ? -1 : i < 0 ? 1 : 0; }

/* before the event of switching off has come, the legs follow from the currents */
static inline int leg(const Unit *m, int x, double i) { return m->off[0] ? m->leg[x] : leg_of(i); }

/* terminal voltage; without current it is the back-EMF */
static inline double open_bridge_voltage(const Unit *m, double i, double e) {
  const int s = six_step(m) ? leg_of(i) : leg(m, 0, i);
  return s != 0 ? s * 2 * diode_voltage(m) : e;
}

/* three phases: derivatives of the currents; returns the voltage of the star point, NAN where nothing conducts */
static inline double open_bridge(const Unit *m, double R, const double i[3], const double e[3], double der[3]) {
  int s[3], n = 0;
  double star = 0;
  for (int x = 0; x < 3; x++) {
    s[x] = leg(m, x, i[x]);
    n += s[x] != 0;
    if (s[x] != 0) star += s[x] * diode_voltage(m) - e[x];
    der[x] = 0;
  }
  if (n < 2) return NAN;
  star /= n;
  for (int x = 0; x < 3; x++)
    if (s[x] != 0) der[x] = (s[x] * diode_voltage(m) - star - e[x] - R / 2 * i[x]) / (m->winding_L / 2);
  return star;
}

/* the leg whose current has come to its end the most, and by how much (negative: flows on) */
static inline double ending(const Unit *m, const double i[], int legs, int *which) {
  double most = -1;
  for (int x = 0; x < legs; x++)
    if (m->leg[x] != 0 && m->leg[x] * i[x] > most) most = m->leg[x] * i[x], *which = x;
  return most;
}

/* how far a voltage lies beyond the diodes of an open leg, which leg, and which diode */
static inline double beyond(const Unit *m, double star, const double e[3], int *which, int *side) {
  double most = -1;
  for (int x = 0; x < 3; x++) {
    if (m->leg[x] != 0) continue;
    const double over = fabs(star + e[x]) - diode_voltage(m);
    if (over > most) most = over, *which = x, *side = star + e[x] > 0 ? 1 : -1;
  }
  return most;
}

static inline void largest_and_smallest(const double e[3], int *high, int *low) {
  *high = *low = 0;
  for (int x = 1; x < 3; x++) {
    if (e[x] > e[*high]) *high = x;
    if (e[x] < e[*low]) *low = x;
  }
}

#endif
