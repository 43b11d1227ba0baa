/* Data acquisition; the table beside this file has every equation's source. */
#define UNIT_SAMPLED
#include "core/unit.h"
#include "acquisition/history.h"
#include "acquisition/noise.h"

static void unit_start(Unit *m) { (void)m; }

/* y as the converter knows it: within +-v_max, in steps of 2 v_max / 2^bits, of which the uppermost is missing */
static inline double converted(const Unit *m, double y, double v_max) {
  if (m->converter_bits == 0) return clamp(y, -v_max, v_max);
  const double q = 2 * v_max / (double)(1 << m->converter_bits);
  return clamp(q * nearbyint(y / q), -v_max, v_max - q);
}

/* from signal to reading: y = k x, reading = y/k; left as it is where nothing was lost */
static inline double channel(const Unit *m, double x, double k, double *y) {
  *y = converted(m, k * x, m->range_v_max);
  return *y == k * x ? x : *y / k;
}

static inline double acs712(const Unit *m, double i, double n) {
  const double y = m->acs712_v_0 + m->acs712_k * clamp(i, -m->acs712_i_max, m->acs712_i_max);
  return converted(m, y + m->acs712_sigma * n, m->range_v_max);
}

/* the seven signals as they arrive at the converter at time t of the last communication step */
static void signals(const Unit *m, double t, double x[7]) {
  const double past = m->time - m->before[0], s = past > 0 ? (t - m->before[0]) / past : 1;
  for (int j = 0; j < 7; j++) {
    const double now = reals(m)[VR_i_motor + j], begin = at_begin_of_step(m, VR_i_motor + j);
    x[j] = s == 1 ? now : begin + s * (now - begin);
  }
  if (m->speed_delay_T > 0) x[1] = remembered(m, SPEED, m->w_motor, t - m->speed_delay_T);
  if (m->torque_delay_T > 0) x[2] = remembered(m, TORQUE, m->tau_sensor, t - m->torque_delay_T);
}

static void unit_equations(Unit *m) {
  double now[7];
  const double *x = m->held + 1;
  if (m->sampling_T_s == 0 || m->count[0] == 0) {
    signals(m, m->time, now);
    x = now;
  }
  m->i_reading = channel(m, x[0] + m->current_offset_i_0 + m->noise_sigma_i * m->n[0], m->range_k_i, &m->y_i);
  m->w_reading = channel(m, x[1] + m->noise_sigma_w * m->n[1], m->range_k_w, &m->y_w);
  m->tau_reading = channel(m, x[2] + m->noise_sigma_tau * m->n[2], m->range_k_tau, &m->y_tau);
  m->y_a = acs712(m, x[3], m->n[3]);
  m->y_b = acs712(m, x[4], m->n[4]);
  m->y_c = acs712(m, x[5], m->n[5]);
  m->v_set = converted(m, x[6], m->range_v_max_out);
}

static void draw_noise(Unit *m) {
  const uint64_t k = m->count[0]++;
  const int seed = m->noise_seed;
  if (m->noise_sigma_i > 0) m->n[0] = normal(seed, 0, k);
  if (m->noise_sigma_w > 0) m->n[1] = normal(seed, 1, k);
  if (m->noise_sigma_tau > 0) {
    const double rho = k == 0 ? 0 : m->noise_rho_tau;
    m->n[2] = rho * m->n[2] + sqrt(1 - rho * rho) * normal(seed, 2, k);
  }
  if (m->acs712_sigma > 0)
    for (int phase = 3; phase < 6; phase++) m->n[phase] = normal(seed, phase, k);
}

static void unit_sample(Unit *m) {
  const double T_s = m->sampling_T_s, slack = 1e-9;
  if (m->count[0] == 0) m->held[0] = m->time;
  amend_newest_row(m);
  if (T_s == 0) {
    draw_noise(m);
  } else if (T_s <= slack || m->time + T_s == m->time) { /* below what time resolves: every point is a sample */
    draw_noise(m);
    signals(m, m->time, m->held + 1);
  } else {
    while (m->held[0] <= m->time + slack) {
      draw_noise(m);
      signals(m, fmin(m->held[0], m->time), m->held + 1);
      m->held[0] += T_s;
    }
  }
  remember(m);
  m->before[0] = m->time;
  unit_equations(m);
}
