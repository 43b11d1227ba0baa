/* FMI 2.0 for co-simulation over one unit: an instance from birth to end; variables.h, steps.h and states.h have the rest.
 * Knows no physics.
 * One translation unit per FMU: EQUATIONS names the unit's equations.c, MODEL_DEF its table, UNIT_GUID is its GUID. */
#include "fmi2/unit.h"

#include EQUATIONS

#include "fmi2/instance.h"

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

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

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean debug) {
  (void)visible;
  if (!callbacks) return NULL;
  Instance probe = {.callbacks = callbacks, .name = (char *)(name ? name : UNIT_NAME)};
#define REFUSE(...) return say(&probe, fmi2Error, "logStatusError", __VA_ARGS__), NULL
  if (!name || !*name) REFUSE("fmi2Instantiate: the instance name is empty");
  if (type != fmi2CoSimulation) REFUSE("fmi2Instantiate: only co-simulation is offered, not model exchange");
  if (!guid) REFUSE("fmi2Instantiate: no GUID given");
  char why[256] = "";
  set_starts(&probe.start);
  const StartFile file = read_start_values(&probe.start, &probe.late, resources, guid, why);
  if (file == START_BAD) REFUSE("fmi2Instantiate: %s", why);
  if (file != START_APPLIED && strcmp(guid, UNIT_GUID) != 0)
    REFUSE("fmi2Instantiate: GUID %s given, this library is %s", guid, UNIT_GUID);
  Instance *c = malloc(sizeof *c);
  char *copy = malloc(strlen(name) + 1);
  if (!c || !copy) {
    free(c);
    free(copy);
    REFUSE("fmi2Instantiate: out of memory");
  }
  strcpy(copy, name);
  *c = probe;
  c->name = copy;
  c->log_events = debug != 0;
  c->phase = INSTANTIATED;
  c->stop_time = DBL_MAX;
  c->unit = c->start;
  return c;
}

void fmi2FreeInstance(fmi2Component component) {
  Instance *c = component;
  if (!c) return;
  free(c->name);
  free(c);
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  NEEDS(ANY);
  if (n > 0) NEEDS_POINTER(categories);
  bool events = n == 0;
  for (size_t i = 0; i < n; i++) {
    const char *given = categories[i] ? categories[i] : "(null)";
    events |= strcmp(given, "logEvents") == 0;
    if (strcmp(given, "logEvents") != 0 && strcmp(given, "logStatusError") != 0 &&
        strcmp(given, "logStatusDiscard") != 0)
      FAIL(c, "fmi2SetDebugLogging: category \"%s\" is unknown; there are logStatusError, logStatusDiscard, logEvents",
           given);
  }
  if (events) c->log_events = on != 0; /* refusals are always told */
  return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_given, fmi2Real stop) {
  NEEDS(INSTANTIATED);
  if (!isfinite(start)) FAIL(c, "fmi2SetupExperiment: startTime %g is not finite", start);
  if (tolerance_given && !(tolerance > 0 && tolerance <= 0.1))
    FAIL(c, "fmi2SetupExperiment: tolerance %g is outside 0 to 0.1", tolerance);
  if (stop_given && !(stop >= start)) FAIL(c, "fmi2SetupExperiment: stopTime %g lies before startTime %g", stop, start);
  c->unit.time = c->unit.start_time = start;
  for (int j = 0; j < N_INPUT; j++) c->unit.u[j].t0 = start;
  if (tolerance_given) c->unit.tolerance = fmin(tolerance, LOOSEST);
  c->stop_time = stop_given ? stop : DBL_MAX;
  return fmi2OK;
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

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
  NEEDS(INSTANTIATED);
  c->phase = INITIALIZATION;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
  NEEDS(INITIALIZATION);
  if (!settle(c)) /* a unit may start on the far side of an event: in contact, say */
    FAIL(c, "fmi2ExitInitializationMode: events follow each other without end");
  for (int i = 0; i < N_PUBLIC; i++)
    if (!isfinite(reals(&c->unit)[i])) {
      char name[NAME_SIZE];
      FAIL(c, "fmi2ExitInitializationMode: %s is not finite; check the parameters",
           full_name(name, REAL_INFO[i].term, REAL_INFO[i].name));
    }
  end_of_step(&c->unit);
  c->phase = STEPPING;
  return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component) {
  NEEDS(STEPPING | STOPPED_SHORT);
  c->phase = TERMINATED;
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component) {
  NEEDS(ANY);
  c->unit = c->start;
  c->stop_time = DBL_MAX;
  c->phase = INSTANTIATED;
  return fmi2OK;
}

#include "fmi2/states.h"
#include "fmi2/steps.h"
#include "fmi2/variables.h"
