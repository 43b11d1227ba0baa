/* Runs along one clock from any of its rows, as cosim/simulation.py runs one: initialised (initialise.py), then stepped. */
#include "restart.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "../../../cosim/master/master.h"

enum { MOST_SWEEPS = 50 };           /* initialise.py says of what */
static const double SETTLED = 1e-12; /* of the value's size */

#define TRY(number, call, what)                                                                                        \
  do {                                                                                                                 \
    fmi2Status status = (call);                                                                                        \
    if (status != fmi2OK && status != fmi2Warning) {                                                                   \
      snprintf(r->message, sizeof r->message, "%s returned %d on being initialised", what, (int)status);               \
      r->failed = (int32_t)(number);                                                                                   \
      return -1;                                                                                                       \
    }                                                                                                                  \
  } while (0)

static int put(Restart *r, const Place *place, double value) {
  const RestartUnit *unit = &r->units[place->unit];
  const int whole = (int)value, truth = value != 0;
  if (place->type == REAL)
    TRY(place->unit, unit->set_real(unit->component, &place->ref, 1, &value), "fmi2SetReal");
  else if (place->type == INTEGER)
    TRY(place->unit, unit->set_integer(unit->component, &place->ref, 1, &whole), "fmi2SetInteger");
  else
    TRY(place->unit, unit->set_boolean(unit->component, &place->ref, 1, &truth), "fmi2SetBoolean");
  return 0;
}

static int take(Restart *r, const Place *place, double *value) {
  const RestartUnit *unit = &r->units[place->unit];
  int found = 0;
  if (place->type == REAL)
    TRY(place->unit, unit->get_real(unit->component, &place->ref, 1, value), "fmi2GetReal");
  else if (place->type == INTEGER)
    TRY(place->unit, unit->get_integer(unit->component, &place->ref, 1, &found), "fmi2GetInteger");
  else
    TRY(place->unit, unit->get_boolean(unit->component, &place->ref, 1, &found), "fmi2GetBoolean");
  if (place->type != REAL) *value = place->type == INTEGER ? found : found != 0;
  return 0;
}

/* One wire, or the wires of an algebraic loop, swept until their values no longer change; last: of each */
static int pass_on(Restart *r, const Pass *passes, int32_t count, int loops, const double *u, double *last) {
  for (int sweep = 0; sweep < MOST_SWEEPS; sweep++) {
    int moved = 0;
    for (int32_t k = 0; k < count; k++) {
      const Pass *pass = &passes[k];
      double value = 0;
      if (pass->from.unit < 0)
        value = u[pass->from.ref];
      else if (take(r, &pass->from, &value))
        return -1;
      value = pass->factor * value + pass->offset;
      if (sweep > 0 && !(fabs(value - last[k]) > SETTLED * (1 + fabs(value)))) continue;
      last[k] = value;
      moved = 1;
      if (put(r, &pass->to, value)) return -1;
    }
    if (!moved || !loops) return 0;
  }
  snprintf(r->message, sizeof r->message, "initial values do not settle in %d sweeps over a loop of wires",
           MOST_SWEEPS);
  r->failed = passes[0].to.unit;
  return -1;
}

static int initialise(Restart *r, const RestartRun *run, double t, double *last) {
  for (size_t i = 0; i < r->n_units; i++) TRY(i, r->units[i].reset(r->units[i].component), "fmi2Reset");
  for (size_t i = 0; i < r->n_settings; i++) {
    const Setting *s = &r->settings[i];
    if (put(r, &s->place, s->state < 0 ? s->value : run->x[s->state])) return -1;
  }
  for (size_t i = 0; i < r->n_units; i++) {
    const RestartUnit *unit = &r->units[i];
    TRY(i, unit->setup_experiment(unit->component, fmi2False, 0, t, fmi2True, r->stop_time), "fmi2SetupExperiment");
    TRY(i, unit->enter_initialization_mode(unit->component), "fmi2EnterInitializationMode");
  }
  const Pass *passes = r->passes;
  for (size_t g = 0; g < r->n_groups; g++) {
    if (pass_on(r, passes, r->groups[g], r->loops[g], run->u, last)) return -1;
    passes += r->groups[g];
  }
  for (size_t i = 0; i < r->n_units; i++)
    TRY(i, r->units[i].exit_initialization_mode(r->units[i].component), "fmi2ExitInitializationMode");
  return 0;
}

/* the next event's tick, or `end`, where none comes before; those that are due are set. -1: a unit refuses */
static int64_t apply(Restart *r, size_t *next, int64_t tick, int64_t end) {
  for (; *next < r->n_events && r->events[*next].tick <= tick; ++*next)
    if (put(r, &r->events[*next].place, r->events[*next].value)) return -1;
  return *next < r->n_events && r->events[*next].tick < end ? r->events[*next].tick : end;
}

static int advance(Restart *r, Master *m, const RestartRun *run, double *table) {
  const int64_t every = m->plan.ticks_per_record, begin = run->first * every, end = begin + (run->rows - 1) * every;
  size_t next = 0;
  int64_t until = apply(r, &next, begin, end);
  if (until < 0) return -1;
  int status = cosim_begin(m, begin);
  if (status) return status;
  if (cosim_record(m, table)) return -1;
  while (m->tick < end) {
    if ((status = cosim_advance(m, until, table + (m->tick / every + 1 - run->first) * (int64_t)m->plan.n_recorded)))
      return status;
    if (m->tick == end) break;
    if ((until = apply(r, &next, m->tick, end)) < 0) return -1;
    if ((status = cosim_resume(m))) return status;
  }
  return 0;
}

int restart_run(Restart *r, Master *m, const RestartRun *run, double *table) {
  double *last = calloc(r->n_passes + 1, sizeof *last);
  if (!last) return -2;
  r->failed = -1;
  m->plan.samples = run->samples;
  m->plan.breaks = run->breaks;
  m->plan.n_breaks = run->n_breaks;
  m->plan.limits = run->limits;
  m->beyond = false;
  int status = initialise(r, run, time_of(m, run->first * m->plan.ticks_per_record), last);
  if (status == 0) status = advance(r, m, run, table);
  free(last);
  return m->beyond ? -3 : status;
}
