/* The master's own data, shared by master.c and unit.c. */
#ifndef COSIM_MASTER_H
#define COSIM_MASTER_H

#include "cosim.h"
#include "signals.h"

typedef struct { /* what one unit needs beside its description: where its inputs' derivatives go */
  fmi2ValueReference *refs;
  fmi2Integer *orders; /* [n][input_order]: 1..input_order */
  fmi2FMUstate state;
} Scratch;

struct Monolithic; /* ../monolithic */

struct Master {
  Plan plan;
  struct Monolithic *monolithic; /* NULL: the units step themselves */
  Scratch *scratch;              /* [n_units] */
  Past *past;                    /* [n_outputs] */
  double *y, *dy;                /* [n_outputs]: at the end of the step under way */
  double *expected;              /* [n_outputs]: what readers took for y */
  Polynomial *p;                 /* [n_outputs + n_inputs] */
  double *work;                  /* [n_ports], J: in the step under way */
  double *total, *total_abs;     /* [n_ports], J: since tick 0, and of its absolute value */
  double *u, *du;                /* inputs of one unit and their derivatives */
  fmi2Integer *first_order;      /* 1, 1, .. */
  int *discrete;                 /* Integers and Booleans of one unit */
  int64_t tick, stride;
  int64_t rows;      /* written since the beginning */
  int64_t calm;      /* steps since the last rejected one */
  size_t next_break; /* breaks[next_break] > tick, the first such */
  size_t sample;     /* sample_time[sample] <= t < sample_time[sample + 1] */
  int known;         /* points in the past, the present one included */
  bool beyond;       /* the plan's limits */
  double h_prev, h_prev2;
  Counters count;
  char message[512];
};

static inline double time_of(const Master *m, int64_t tick) { return m->plan.start_time + (double)tick * m->plan.step; }

/* variables that drive inputs come first among a unit's signals: Reals, then these */
static inline size_t n_discrete(const Unit *unit) { return unit->integer_outputs.n + unit->boolean_outputs.n; }
static inline size_t n_watched(const Unit *unit) {
  return unit->real_watched.n + unit->integer_watched.n + unit->boolean_watched.n;
}

/* a Real signal over the step whose end has been computed */
static inline Polynomial interpolated(const Master *m, const Unit *unit, size_t s, double h) {
  bool cubic = m->plan.scheme.interpolation == 3 && unit->output_derivatives;
  return cubic ? hermite(m->past[s].y, m->past[s].dy, m->y[s], m->dy[s], h) : line(m->past[s].y, m->y[s], h);
}

static inline bool rolls_back(const Master *m) { return m->plan.scheme.sweeps > 1 || m->plan.scheme.adaptive; }

/* unit.c: all return 0, or -1 with a message that says which unit, which call, at what time */
enum { DISCARDED = 1 }; /* from step_unit alone: a shorter step is to be tried */
/* From s to s + h of the step that begins at t: inputs' polynomials in, y and dy out */
int step_unit(Master *m, size_t i, double t, double s, double h);
int set_discrete_inputs(Master *m, const Unit *unit);
int get_outputs(Master *m, const Unit *unit);      /* those that drive inputs, into y */
int get_watched(Master *m, const Unit *unit);      /* those that are only recorded, into y */
int get_first_slopes(Master *m, const Unit *unit); /* before its first step, into dy; 0 where it knows none yet */
int save_states(Master *m);
int restore_states(Master *m);

#endif
