/* What a delayed channel remembers: a ring of rows (time, speed, torque), the newest at the last communication point. */
#include "fmi2/unit.h"

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

/* the present communication point becomes the newest row; rows closer than 1/200 of the longest delay are not kept */
static inline void remember(Unit *m) {
  const double longest = fmax(m->speed_delay_T, m->torque_delay_T), spacing = longest > 0 ? longest / 200 : INFINITY;
  const int filled = m->rows[0];
  const bool too_close = filled > 1 && row_before(m, 0)[0] - row_before(m, 1)[0] < spacing;
  if (filled == 0) {
    m->rows[0] = 1;
  } else if (!too_close && row_before(m, 0)[0] < m->time && longest > 0) {
    m->rows[1] = (m->rows[1] + 1) % ROWS;
    if (filled < ROWS) m->rows[0]++;
  }
  double *newest = m->history + ROW * m->rows[1];
  newest[0] = m->time;
  newest[SPEED] = m->w_motor;
  newest[TORQUE] = m->tau_sensor;
}
