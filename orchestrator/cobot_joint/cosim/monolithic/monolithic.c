#include "monolithic/monolithic.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "monolithic/stepper.h"

static const double SHORTEST = 1e-12;                   /* s, of a step and of what brackets an event */
static const double LONGEST = 16e-3;                    /* s */
static const double FIRST = 1e-4;                       /* s, tried first, and after an event */
static const double CLOSE = 1e-7;                       /* s, between events */
static const double SHORT = 1.5e-3;                     /* s, of steps that an explicit method may take as well */
static const double COST = 4;                           /* of an implicit step, in explicit ones */
static const double BETA = 0.08;                        /* by how much the last error counts, explicit steps */
static const double SMALL = 1e-4;                       /* of an error, in the one allowed: smaller counts as this */
enum { TRIAL = 3, PATIENCE = 16, MOST_PATIENCE = 256 }; /* steps */
enum { MOST_TRIES = 100, MOST_EVENTS_AT_ONCE = 64 };

struct Monolithic {
  FieldSystem *system;
  Stepper stepper;
  bool asked[MOST_UNITS];       /* whether rows or sinks take outputs of a unit that its equations do not give */
  double *before;               /* [n_outputs + n_inputs]: signals when the sinks were last stepped */
  size_t n_sunk, *sunk;         /* signals that sinks take */
  int64_t begun, sinks_at;      /* ticks */
  double next_step, next_event; /* s */
  double last_error;            /* of the last step taken, in the one allowed */
  bool is_explicit;
  int trial, wait, patience; /* steps left of a trial of the other method; steps until the next */
  double other_step;         /* s, of the method that the one on trial would replace */
  double last_event, apart;  /* s: when, and how long no other is looked for */
  size_t next_break;         /* breaks[next_break] is later than now, the first such */
};

static int trouble(Master *m, const char *what, double t) {
  snprintf(m->message, sizeof m->message, "the units as one system: %s at t = %.9g s", what, t);
  return -1;
}

static void refused(Master *m, const Unit *unit, const char *why) {
  snprintf(m->message, sizeof m->message, "the units as one system: %s %s", unit->name, why);
}

static bool sinks_take(const Plan *plan, size_t signal) {
  for (size_t i = 0; i < plan->n_units; i++)
    for (size_t k = 0; plan->units[i].is_sink && k < plan->units[i].real_inputs.n; k++)
      if ((size_t)plan->units[i].wires[k].signal == signal) return true;
  return false;
}

Monolithic *monolithic_create(const Plan *plan) {
  Monolithic *o = calloc(1, sizeof *o);
  if (!o) return NULL;
  o->system = o->stepper.system = system_create(plan);
  o->before = calloc(plan->n_outputs + plan->n_inputs + 1, sizeof *o->before);
  o->sunk = calloc(plan->n_outputs + plan->n_inputs + 1, sizeof *o->sunk);
  if (o->system && o->before && o->sunk) {
    for (size_t s = 0; s < plan->n_outputs + plan->n_inputs; s++)
      if (sinks_take(plan, s)) o->sunk[o->n_sunk++] = s;
    return o;
  }
  monolithic_destroy(o);
  return NULL;
}

void monolithic_destroy(Monolithic *o) {
  if (!o) return;
  system_destroy(o->system);
  free(o->before);
  free(o->sunk);
  free(o);
}

static bool is_recorded(const Plan *plan, size_t signal) {
  for (size_t k = 0; k < plan->n_recorded; k++)
    if ((size_t)plan->recorded[k].signal == signal) return true;
  return false;
}

static bool is_asked(const Plan *plan, const FieldUnit *u, double t) {
  bool asked = n_watched(u->unit) > 0;
  for (size_t j = 0; j < u->unit->real_outputs.n; j++) {
    const size_t s = (size_t)u->unit->first_signal + j;
    asked |= (sinks_take(plan, s) || is_recorded(plan, s)) && !system_gives(u, j, t);
  }
  return asked;
}

int monolithic_begin(Monolithic *o, Master *m) {
  o->next_step = FIRST;
  o->last_error = SMALL;
  o->next_break = 0;
  o->begun = o->sinks_at = m->tick;
  o->apart = 0;
  o->is_explicit = false;
  o->trial = 0;
  o->wait = o->patience = PATIENCE;
  o->last_event = -INFINITY;
  const Unit *unit = system_begin(o->system, o->stepper.x);
  if (unit) return refused(m, unit, "is not initialized"), -1;
  if ((unit = system_unfit(o->system, time_of(m, m->tick))))
    return refused(m, unit, "gives another what does not follow from its states and inputs"), COSIM_UNFIT;
  for (size_t k = 0; k < o->system->n_units; k++) {
    o->asked[k] = is_asked(&m->plan, &o->system->units[k], time_of(m, m->tick));
    if (o->asked[k]) system_take_unit(o->system, &o->system->units[k]);
  }
  for (size_t k = 0; k < m->plan.n_recorded; k++) system_take(o->system, (size_t)m->plan.recorded[k].signal);
  for (size_t k = 0; k < o->n_sunk; k++) system_take(o->system, o->sunk[k]);
  if (monolithic_resume(o, m)) return -1;
  memcpy(o->before, o->system->signal, (m->plan.n_outputs + m->plan.n_inputs) * sizeof *o->before);
  return 0;
}

/* Integers and Booleans that the system's inputs drive; *moved where a unit has any */
static int set_discrete(Monolithic *o, Master *m, bool *moved) {
  for (size_t s = m->plan.n_outputs; s < m->plan.n_outputs + m->plan.n_inputs; s++)
    m->p[s] = constant(o->system->signal[s]);
  for (size_t k = 0; k < o->system->n_units; k++) {
    const Unit *unit = o->system->units[k].unit;
    if (unit->integer_inputs.n + unit->boolean_inputs.n == 0) continue;
    if (set_discrete_inputs(m, unit)) return -1;
    *moved = true;
  }
  return 0;
}

/* all that is due at the present point happens, and the integrator knows nothing of what follows */
static int events_here(Monolithic *o, Master *m) {
  Stepper *r = &o->stepper;
  for (int n = 0; n < MOST_EVENTS_AT_ONCE; n++) {
    r->there = false;
    stay(r);
    if (n > 0 && !(system_indicator(o->system) > 0)) {
      r->linear = false;
      o->next_step = fmin(o->next_step, FIRST);
      o->next_event = system_next_event(o->system);
      return 0;
    }
    if (system_happen(o->system, r->t, r->x)) break;
  }
  return trouble(m, "events follow each other without end", r->t);
}

int monolithic_resume(Monolithic *o, Master *m) {
  bool moved;
  o->stepper.t = time_of(m, m->tick);
  o->stepper.there = false;
  stay(&o->stepper);
  return set_discrete(o, m, &moved) || events_here(o, m) ? -1 : 0;
}

/* A tick inside of the step last made: units whose outputs are taken are asked, sinks follow, a recorded tick gets its row. */
static int arrive(Monolithic *o, Master *m, int64_t tick, double **row) {
  const Plan *plan = &m->plan;
  const double t = time_of(m, tick), h = (double)(tick - o->sinks_at) * plan->step;
  double x[MOST_STATES];
  between(&o->stepper, t, x);
  o->stepper.there = false;
  o->system->since = t;
  system_look(o->system, t, x);
  for (size_t k = 0; k < o->system->n_units; k++) {
    const FieldUnit *u = &o->system->units[k];
    if (!o->asked[k]) continue;
    u->field->observe(u->instance, t);
    for (size_t j = 0; j < u->n_given; j++) *u->given[j].to = *u->given[j].from;
  }
  for (size_t k = 0; k < o->n_sunk; k++) {
    const size_t s = o->sunk[k];
    const double y = o->system->signal[s];
    m->p[s] = line(o->before[s], y, h);
    o->before[s] = y;
  }
  memcpy(m->y, o->system->signal, plan->n_outputs * sizeof *m->y);
  for (size_t i = 0; i < plan->n_units; i++)
    if (plan->units[i].is_sink && step_unit(m, i, time_of(m, o->sinks_at), 0, h)) return -1;
  o->sinks_at = m->tick = tick;
  m->sample = o->system->sample;
  if (tick % plan->ticks_per_record) return 0;
  if (cosim_record(m, *row)) return -1;
  *row += plan->n_recorded;
  return 0;
}

/* the rows up to t, and the tick `last` where it is there */
static int write_rows(Monolithic *o, Master *m, int64_t last, double t, double **row) {
  const int64_t every = m->plan.ticks_per_record;
  for (int64_t tick = m->tick; tick < last;) {
    tick = (tick / every + 1) * every;
    if (tick > last) tick = last;
    if (time_of(m, tick) > t + SHORTEST) break;
    if (arrive(o, m, tick, row)) return -1;
  }
  return 0;
}

/* the largest indicator inside of the step last made */
static double indicator_between(Monolithic *o, double t) {
  double x[MOST_STATES], f[MOST_STATES];
  between(&o->stepper, t, x);
  system_evaluate(o->system, t, x, f);
  return system_indicator(o->system);
}

/* Where in the step an event is due first, just behind the root of its indicator on the interpolant: the secant, every third
 * time a bisection. z_end: the indicator at the step's end. */
static double first_event(Monolithic *o, double z_end) {
  double low = o->stepper.t, high = low + o->stepper.h, z_low = indicator_between(o, low), z_high = z_end;
  const double enough = fmax(SHORTEST, 4 * DBL_EPSILON * fabs(high));
  for (int n = 0; n < MOST_TRIES && high - low > enough; n++) {
    double t = n % 3 == 2 || !(z_low < 0) ? low + (high - low) / 2 : high - z_high * (high - low) / (z_high - z_low);
    t = fmin(fmax(t, low + enough / 4), high - enough / 4);
    const double z = indicator_between(o, t);
    if (z > 0)
      high = t, z_high = z;
    else
      low = t, z_low = z;
  }
  return fmin(fmax(high, o->stepper.t + o->apart), o->stepper.t + o->stepper.h);
}

/* Events that follow each other closely are taken together, more and more of them: where a force rests at zero, rounding alone
 * would call up one after the other. */
static void space_events(Monolithic *o, double t) {
  o->apart = t - o->last_event < 4 * o->apart + CLOSE ? fmin(fmax(2 * o->apart, CLOSE), FIRST) : 0;
  o->last_event = t;
}

/* How far the next step may go: to `end`, a turn of an input, an event that comes by time. */
static double limit(Monolithic *o, const Master *m, double end) {
  const Plan *plan = &m->plan;
  const double t = o->stepper.t;
  while (o->next_break < plan->n_breaks && time_of(m, plan->breaks[o->next_break]) <= t + SHORTEST) o->next_break++;
  if (o->next_break < plan->n_breaks) end = fmin(end, time_of(m, plan->breaks[o->next_break]));
  return fmax(fmin(end, o->next_event) - t, 0);
}

static void change_method(Monolithic *o, double next_step) {
  o->is_explicit = !o->is_explicit;
  o->next_step = next_step;
  o->wait = o->patience;
}

/* Which method takes the next step: an explicit step costs a fourth, so that it has to go a fourth as far. Now and then, more and
 * more seldom where that leads nowhere, the other is tried for some steps; where steps are long, the explicit one is not. */
static void choose_method(Monolithic *o, double h, bool accepted) {
  const bool worth = o->is_explicit ? h * COST > o->other_step : h > o->other_step * COST;
  if (o->trial == 0) {
    if (!accepted || --o->wait > 0 || (!o->is_explicit && h > SHORT)) return;
    o->other_step = h;
    o->trial = TRIAL;
    change_method(o, o->is_explicit ? 2 * COST * h : h);
  } else if (worth && accepted) {
    o->trial = 0;
    o->wait = o->patience = PATIENCE;
  } else if ((accepted && --o->trial == 0) || (!accepted && !worth)) {
    o->trial = 0;
    o->patience = o->patience < MOST_PATIENCE ? 2 * o->patience : MOST_PATIENCE;
    change_method(o, o->other_step);
  }
}

/* How many times longer the next step may be. Where stability bounds explicit steps, PI control rejects fewer of them:
 * Gustafsson 1991, ACM Trans. Math. Softw. 17(4); Hairer and Wanner 1996, Solving ODEs II, sec. IV.2. */
static double room_after(const Monolithic *o, double error) {
  const bool accepted = error <= 1;
  double room = o->is_explicit ? pow(error, 0.75 * BETA - 0.2) : pow(error, -0.25);
  if (o->is_explicit && accepted) room *= pow(o->last_error, BETA);
  return fmin(fmax(0.9 * room, 0.2), accepted ? 4 : 0.8);
}

/* One step that the error allows, no further than by `most`; its end, or where an event is due within it, in *end. */
static int make_step(Monolithic *o, Master *m, double most, double *end, bool *event) {
  Stepper *r = &o->stepper;
  r->system->since = r->t;
  for (bool again = false;; m->count.rejected++, again = true) {
    double h = fmin(fmin(o->next_step, LONGEST), most);
    if (h < most && h > most / 2) h = most / 2; /* rather than leaving a crumb */
    if (!(h > SHORTEST / 4)) return trouble(m, "the step size went to zero", r->t), COSIM_STUCK;
    const bool is_explicit = o->is_explicit;
    const double error = (is_explicit ? dopri_step : rodas_step)(r, h, m->plan.scheme.tolerance);
    const double room = fmin(room_after(o, error), again ? 1 : 4); /* none longer right after a rejection */
    if (error <= 1) {
      if (!is_explicit) system_evaluate(o->system, r->t + h, r->y, r->k[AT_END]); /* where the other's last stage is */
      o->last_error = fmax(error, SMALL);
      o->next_step =
          h < o->next_step ? fmax(o->next_step, h * room) : h * room; /* cut short: nothing against longer ones */
      choose_method(o, h, true);
      break;
    }
    o->next_step = h * (error < 1e12 ? room : 0.1);
    choose_method(o, o->next_step, false);
  }
  m->count.steps++;
  *end = r->t + r->h;
  const double z = system_indicator(o->system);
  *event = z > 0;
  if (*event) space_events(o, *end = first_event(o, z));
  return 0;
}

static bool at_break(const Monolithic *o, const Master *m) {
  const Plan *plan = &m->plan;
  return o->next_break < plan->n_breaks && time_of(m, plan->breaks[o->next_break]) <= o->stepper.t + SHORTEST;
}

/* The present point is where the step last made ends, or an event is due within it. */
static void move_on(Monolithic *o, double end) {
  Stepper *r = &o->stepper;
  const size_t size = o->system->n * sizeof(double);
  if (end == r->t + r->h) {
    memcpy(r->x, r->y, size);
    memcpy(r->f, r->k[AT_END], size);
  } else {
    between(r, end, r->x);
  }
  r->t = end;
}

int monolithic_advance(Monolithic *o, Master *m, int64_t tick, double *rows) {
  Stepper *r = &o->stepper;
  const double stop = time_of(m, tick);
  while (m->tick < tick) {
    const double most = limit(o, m, stop);
    double end = r->t;
    bool event = most <= SHORTEST; /* one that comes by time */
    const int status = event ? 0 : make_step(o, m, most, &end, &event);
    if (status) return status;
    if (end > r->t) {
      const bool reaches = end >= r->t + most - SHORTEST;
      r->there = !event;
      if (write_rows(o, m, tick, end, &rows)) return -1;
      move_on(o, end);
      if (reaches && !event) event = r->t >= o->next_event - SHORTEST;
    }
    r->linear = false;
    if (at_break(o, m)) { /* where an input jumps, so may f, and what depends on it may be due */
      r->there = false;
      stay(r);
      event |= system_indicator(o->system) > 0;
      if (set_discrete(o, m, &event)) return -1;
    }
    if (event && events_here(o, m)) return -1;
    const double most_steps = m->plan.scheme.pace * (1 + r->t - time_of(m, o->begun));
    if ((double)(m->count.steps + m->count.rejected) > most_steps)
      return trouble(m, "more steps than its pace allows", r->t), COSIM_UNFIT;
  }
  stay(r);
  return 0;
}
