/* Ratio of one planetary stage from its teeth: Willis' equation w_s z_s + w_r z_r = w_c (z_s + z_r) with one member held.
 * Table 2.3 of the thesis; its row 2 (ring in, sun held) is the smallest reduction, not the largest. */
#include "core/unit.h"

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

/* meshes per turn of the stage's output: z_s |w_s - w_c| over its speed */
static inline double meshes_per_turn(int member, double z_s, double z_r) {
  switch (member) {
    case SUN_IN_CARRIER_OUT:
    case SUN_IN_RING_OUT: return z_r;
    case RING_IN_CARRIER_OUT:
    case RING_IN_SUN_OUT: return z_s;
    case CARRIER_IN_RING_OUT:
    case CARRIER_IN_SUN_OUT: return z_s * z_r / (z_s + z_r);
    default: return 0;
  }
}

/* of each stage, per turn of the gear's output; 0 where there is no such stage, or no such gear */
static inline void mesh_orders(const Unit *m, double order[3]) {
  const int member[3] = {m->ratio_member_1, m->ratio_member_2, m->ratio_member_3};
  const double z_s[3] = {m->ratio_z_s_1, m->ratio_z_s_2, m->ratio_z_s_3};
  const double z_r[3] = {m->ratio_z_r_1, m->ratio_z_r_2, m->ratio_z_r_3};
  double behind = 1; /* turns of a stage's output per turn of the gear's */
  for (int k = 2; k >= 0; k--) {
    order[k] = k < m->ratio_stages ? meshes_per_turn(member[k], z_s[k], z_r[k]) * behind : 0;
    if (!isfinite(order[k])) order[k] = 0;
    if (k < m->ratio_stages) behind *= fabs(stage_ratio(member[k], z_s[k], z_r[k]));
  }
}

static inline double total_ratio(const Unit *m) {
  if (m->ratio_from == 1) return m->ratio_N;
  double N = stage_ratio(m->ratio_member_1, m->ratio_z_s_1, m->ratio_z_r_1);
  if (m->ratio_stages > 1) N *= stage_ratio(m->ratio_member_2, m->ratio_z_s_2, m->ratio_z_r_2);
  if (m->ratio_stages > 2) N *= stage_ratio(m->ratio_member_3, m->ratio_z_s_3, m->ratio_z_r_3);
  return N;
}
