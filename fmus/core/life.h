/* An instance from birth to end. */
#ifndef COBOT_JOINT_LIFE_H
#define COBOT_JOINT_LIFE_H

#include "core/instance.h"

/* relative tolerance; some masters suggest 0.1 unasked (Maestro), at which a mesh under held inputs swings */
static const double LOOSEST = 1e-4;

static void set_starts(Unit *m) {
  memset(m, 0, sizeof *m);
  for (int i = 0; i < N_PUBLIC; i++) reals(m)[i] = REAL_INFO[i].start;
  for (int i = 1; i < N_INTEGER; i++) integers(m)[i] = INTEGER_INFO[i].start;
  for (int i = 1; i < N_BOOLEAN; i++) booleans(m)[i] = BOOLEAN_INFO[i].start;
  for (int j = 0; j < N_INPUT; j++) m->u[j].c[0] = reals(m)[FIRST_INPUT + j];
  m->tolerance = 1e-6;
  m->step = 1e-4;
  m->stale = m->restart = 1;
}

static inline bool is_initialized(const Instance *c) {
  return c->phase & (STEPPING | EVENT | INTERMEDIATE | CONTINUOUS);
}

/* An instance of `size` bytes that begins as *c, which has a log. NULL: refused, and said why. */
static void *new_instance(Instance *c, size_t size, const char *name, const char *guid, const char *resources) {
#define REFUSE(...) return say(c, REFUSED, "logStatusError", __VA_ARGS__), NULL
  c->name = (char *)(name ? name : UNIT_NAME);
  if (!name || !*name) REFUSE("the instance name is empty");
  if (!guid) REFUSE("no GUID given");
  char why[256] = "";
  set_starts(&c->start);
  const StartFile file = read_start_values(&c->start, &c->late, resources, guid, why);
  if (file == START_BAD) REFUSE("%s", why);
  if (file != START_APPLIED && strcmp(guid, UNIT_GUID) != 0)
    REFUSE("GUID %s given, this library is %s", guid, UNIT_GUID);
  Instance *fresh = malloc(size);
  char *copy = malloc(strlen(name) + 1);
  if (!fresh || !copy) {
    free(fresh);
    free(copy);
    REFUSE("out of memory");
  }
  strcpy(copy, name);
  c->name = copy;
  c->phase = INSTANTIATED;
  c->stop_time = DBL_MAX;
  c->unit = c->start;
  memcpy(fresh, c, size);
  return fresh;
#undef REFUSE
}

static void free_instance(Instance *c) {
  if (!c) return;
  free(c->name);
  free(c);
}

static Status set_logging(Instance *c, bool on, size_t n, const char *const categories[]) {
  if (n > 0) NEEDS_POINTER(categories);
  bool events = n == 0;
  for (size_t i = 0; i < n; i++) {
    const char *given = categories[i] ? categories[i] : "(null)";
    events |= strcmp(given, "logEvents") == 0;
    if (strcmp(given, "logEvents") != 0 && strcmp(given, "logStatusError") != 0 &&
        strcmp(given, "logStatusDiscard") != 0)
      FAIL(c, "category \"%s\" is unknown; there are logStatusError, logStatusDiscard, logEvents", given);
  }
  if (events) c->log_events = on; /* refusals are always told */
  return OK;
}

/* tolerance: NULL for the unit's own; stop: NULL where none is defined */
static Status set_experiment(Instance *c, const double *tolerance, double start, const double *stop) {
  if (!isfinite(start)) FAIL(c, "startTime %g is not finite", start);
  if (tolerance && !(*tolerance > 0 && *tolerance <= 0.1)) FAIL(c, "tolerance %g is outside 0 to 0.1", *tolerance);
  if (stop && !(*stop >= start)) FAIL(c, "stopTime %g lies before startTime %g", *stop, start);
  c->unit.time = c->unit.start_time = start;
  for (int j = 0; j < N_INPUT; j++) c->unit.u[j].t0 = start;
  if (tolerance) c->unit.tolerance = fmin(*tolerance, LOOSEST);
  c->stop_time = stop ? *stop : DBL_MAX;
  return OK;
}

/* outputs as states, inputs and parameters have them now */
static void refresh(Unit *m) {
  if (m->restart) {
    unit_start(m);
    m->restart = 0;
    m->stale = 1;
  }
  if (!m->stale) return;
  evaluate_outputs(m, m->time);
  m->stale = 0;
}

/* While initializing, a unit is a function of states, inputs and parameters: values whose time has come hold, and every event
 * that is due has happened, so that a gear whose flanks overlap is in contact. false: events follow each other without end. */
static bool settle(Instance *c) {
  if (c->phase == INITIALIZATION && apply_late(&c->late, &c->unit)) c->unit.restart = 1;
#if defined UNIT_EVENTS
  const bool moved = c->unit.restart || c->unit.stale;
#endif
  refresh(&c->unit);
#if defined UNIT_EVENTS
  if (c->phase == INITIALIZATION && moved) {
    const bool settled = events_here(&c->unit);
    evaluate_outputs(&c->unit, c->unit.time);
    return settled;
  }
#endif
  return true;
}

static Status end_initialization(Instance *c) {
  if (!settle(c)) /* a unit may start on the far side of an event: in contact, say */
    FAIL(c, "events follow each other without end");
  for (int i = 0; i < N_PUBLIC; i++)
    if (!isfinite(reals(&c->unit)[i])) {
      char name[NAME_SIZE];
      FAIL(c, "%s is not finite; check the parameters", full_name(name, REAL_INFO[i].term, REAL_INFO[i].name));
    }
  end_of_step(&c->unit, false);
  c->phase = STEPPING;
  return OK;
}

static inline Status go(Instance *c, Phase phase) {
  c->phase = phase;
  return OK;
}

static Status reset(Instance *c) {
  c->unit = c->start;
  c->stop_time = DBL_MAX;
  c->phase = INSTANTIATED;
  return OK;
}

#endif
