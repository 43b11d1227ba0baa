/* What a unit of a parameter adds from sample to sample and to the readings: many values of other parameters at once. */
#include "effect.h"

#include <stdlib.h>
#include <string.h>

#include "rows.h"

typedef struct {
  double *known, *columns, *sum; /* [n_known], [n_columns][unknown]; [n_x][n_columns], of derivatives of states */
  double *before, *now, *mean;   /* [unknown][n_columns] */
  double *moved;                 /* [n_x][n_columns] */
} Room;

static double *room_for(const Effect *e, Room *at) {
  const size_t J = e->n_columns * (e->n_inner + e->n_outer), x = e->n_columns * e->n_x;
  double *room = calloc(e->n_known + 4 * J + 2 * x + 1, sizeof *room);
  if (!room) return NULL;
  at->known = room;
  at->columns = at->known + e->n_known;
  at->before = at->columns + J;
  at->now = at->before + J;
  at->mean = at->now + J;
  at->sum = at->mean + J;
  at->moved = at->sum + x;
  return room;
}

/* J: [unknown][n_columns] */
INNER int look(const Effect *e, Room *at, double t, const double *known, size_t sample, double *J) {
  const size_t n_unknown = e->n_inner + e->n_outer;
  const double *columns = e->jacobian ? e->jacobian + sample * e->n_columns * n_unknown : at->columns;
  if (!e->jacobian && cosim_varied(e->function, t, known, &e->varied, e->n_columns, e->values, at->columns)) return -1;
  for (size_t c = 0; c < e->n_columns; c++)
    for (size_t r = 0; r < n_unknown; r++) J[r * e->n_columns + c] = columns[c * n_unknown + r];
  return 0;
}

INNER int is_zero(size_t n, const double *x) {
  for (size_t i = 0; i < n; i++)
    if (x[i] != 0) return 0;
  return 1;
}

/* psi += Hold (inner + T outer): what held derivatives add to the states */
INNER void hold(const Effect *e, Room *at, size_t step, const double *J, double *psi) {
  const size_t n_c = e->n_columns, n_x = e->n_x;
  const double *Hold = e->Hold + step * n_x * n_x, *T = e->T + step * n_x * e->n_o;
  memset(at->sum, 0, n_x * n_c * sizeof *at->sum);
  for (size_t r = 0; r < e->n_inner; r++)
    for (size_t c = 0; c < n_c; c++) at->sum[(size_t)e->inner[r] * n_c + c] += J[r * n_c + c];
  for (size_t r = 0; r < e->n_outer; r++) {
    const double *outer = J + (e->n_inner + r) * n_c;
    if (is_zero(n_c, outer)) continue;
    for (size_t i = 0; i < n_x; i++) add_rows(1, T + i * e->n_o + e->outer[r], 1, outer, n_c, at->sum + i * n_c);
  }
  for (size_t j = 0; j < n_x; j++) { /* most terms move one state */
    if (is_zero(n_c, at->sum + j * n_c)) continue;
    for (size_t i = 0; i < n_x; i++) add_rows(1, Hold + i * n_x + j, 1, at->sum + j * n_c, n_c, psi + i * n_c);
  }
}

/* of what changes within a step, summed over parts of it; the known are linear in between */
INNER int inside(const Effect *e, Room *at, size_t step, double *psi) {
  const double *begin = e->known + step * e->n_known, *end = begin + e->n_known, h = e->time[1] - e->time[0];
  for (size_t k = 0; k < e->points; k++) {
    const double share = ((double)k + 0.5) / (double)e->points;
    for (size_t j = 0; j < e->n_known; j++) at->known[j] = begin[j] + share * (end[j] - begin[j]);
    if (look(e, at, e->time[step] + share * h, at->known, 0, at->mean)) return -1;
    multiply(e->n_x, e->n_x, e->n_columns, e->Phi + step * e->n_x * e->n_x, psi, at->moved);
    memcpy(psi, at->moved, e->n_x * e->n_columns * sizeof *psi);
    hold(e, at, step, at->mean, psi);
  }
  return 0;
}

WIDE int effect_along(const Effect *e) {
  Room at;
  double *room = room_for(e, &at);
  if (!room) return -2;
  const size_t n_c = e->n_columns, size = n_c * (e->n_inner + e->n_outer);
  int status = 0;
  memset(e->psi, 0, (e->n - 1) * e->n_x * n_c * sizeof *e->psi);
  memset(e->direct, 0, e->n * e->n_y * n_c * sizeof *e->direct);
  for (size_t k = 0; status == 0 && k < e->n; k++) {
    if ((status = look(e, &at, e->time[k], e->known + k * e->n_known, k, at.now))) break;
    for (size_t y = 0; y < e->n_y; y++)
      for (size_t r = 0; r < e->n_outer; r++)
        add_rows(1, e->S + (k * e->n_y + y) * e->n_o + e->outer[r], 1, at.now + (e->n_inner + r) * n_c, n_c,
                 e->direct + (k * e->n_y + y) * n_c);
    if (k == 0) {
      /* no step leads to it */
    } else if (e->points) {
      status = inside(e, &at, k - 1, e->psi + (k - 1) * e->n_x * n_c);
    } else {
      for (size_t i = 0; i < size; i++) at.mean[i] = (at.before[i] + at.now[i]) / 2;
      hold(e, &at, k - 1, at.mean, e->psi + (k - 1) * e->n_x * n_c);
    }
    memcpy(at.before, at.now, size * sizeof *at.now);
  }
  free(room);
  return status;
}
