/* Ratio of one planetary stage from its teeth: Willis' equation w_s z_s + w_r z_r = w_c (z_s + z_r) with one member held.
 * Table 2.3 of the thesis; its row 2 (ring in, sun held) is the smallest reduction, not the largest. */
#include "fmi2/unit.h"

enum {
  SUN_IN_CARRIER_OUT = 1,
  RING_IN_CARRIER_OUT,
  SUN_IN_RING_OUT,
  RING_IN_SUN_OUT,
  CARRIER_IN_RING_OUT,
  CARRIER_IN_SUN_OUT,
  LOCKED,
  NEUTRAL
};

/* input speed over output speed; infinite where nothing is held and no torque passes */
static inline double stage_ratio(int member, double z_s, double z_r) {
  if (z_r <= z_s) return NAN; /* the sun turns inside the ring; the initialization refuses */
  switch (member) {
    case SUN_IN_CARRIER_OUT: return (z_s + z_r) / z_s; /* eq. 2.27 */
    case RING_IN_CARRIER_OUT: return (z_s + z_r) / z_r;
    case SUN_IN_RING_OUT: return -z_r / z_s;
    case RING_IN_SUN_OUT: return -z_s / z_r;
    case CARRIER_IN_RING_OUT: return z_r / (z_s + z_r);
    case CARRIER_IN_SUN_OUT: return z_s / (z_s + z_r);
    case LOCKED: return 1;
    default: return INFINITY;
  }
}

static inline double total_ratio(const Unit *m) {
  if (m->ratio_from == 1) return m->ratio_N;
  double N = stage_ratio(m->ratio_member_1, m->ratio_z_s_1, m->ratio_z_r_1);
  if (m->ratio_stages > 1) N *= stage_ratio(m->ratio_member_2, m->ratio_z_s_2, m->ratio_z_r_2);
  if (m->ratio_stages > 2) N *= stage_ratio(m->ratio_member_3, m->ratio_z_s_3, m->ratio_z_r_3);
  return N;
}
