/* What a delayed channel remembers: a ring of rows (time, speed, torque), the newest at the last communication point. */
#include "core/unit.h"

enum { ROW = 3, SPEED = 1, TORQUE = 2, ROWS = sizeof((Unit *)0)->history / sizeof(double) / ROW };

static inline const double *row_before(const Unit *m, int n) {
  return m->history + ROW * ((m->rows[1] - n + ROWS) % ROWS);
}

/* what the channel's input, now x, was at time t: linear between rows, the oldest value before them */
static inline double remembered(const Unit *m, int column, double x, double t) {
  double t1 = m->time, x1 = x;
  for (int n = m->rows[0] > 0 && row_before(m, 0)[0] >= m->time ? 1 : 0; n < m->rows[0]; n++) {
    const double *row = row_before(m, n), t0 = row[0], x0 = row[column];
    if (t0 <= t) return t1 > t0 ? x0 + (x1 - x0) * (t - t0) / (t1 - t0) : x1;
    t1 = t0;
    x1 = x0;
  }
  return x1;
}

/* an input when the step that has just ended began; it may have been set after the step before had ended */
static inline double at_begin_of_step(const Unit *m, int reference) { return m->u[reference - FIRST_INPUT].c[0]; }

static inline void amend_newest_row(Unit *m) {
  double *newest = m->history + ROW * m->rows[1];
  newest[SPEED] = at_begin_of_step(m, VR_w_motor);
  newest[TORQUE] = at_begin_of_step(m, VR_tau_sensor);
}

/* the present communication point becomes the newest row; rows closer than 1/200 of the longest delay are not kept */
static inline void remember(Unit *m) {
  const double longest = fmax(m->speed_delay_T, m->torque_delay_T);
  const int filled = m->rows[0];
  const bool too_close = filled > 1 && row_before(m, 0)[0] - row_before(m, 1)[0] < longest / 200;
  if (filled == 0) {
    m->rows[0] = 1;
  } else if (longest > 0 && !too_close && row_before(m, 0)[0] < m->time) {
    m->rows[1] = (m->rows[1] + 1) % ROWS;
    if (filled < ROWS) m->rows[0]++;
  }
  double *newest = m->history + ROW * m->rows[1];
  newest[0] = m->time;
  newest[SPEED] = m->w_motor;
  newest[TORQUE] = m->tau_sensor;
}
