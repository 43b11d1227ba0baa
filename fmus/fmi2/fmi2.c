/* FMI 2.0 for co-simulation over one unit: state machine, checks, variables, steps, FMU states. Knows no physics.
 * One translation unit per FMU: EQUATIONS names the unit's equations.c, MODEL_DEF its table. */
#include "fmi2/unit.h"

#include EQUATIONS

#include <stdarg.h>
#include <stdlib.h>

#include "fmi2/integrate.h"
#include "fmi2/start_values.h"
#include "fmi2Functions.h"

/* FMI 2.0.4, 4.2.4 "State Machine for Co-Simulation" */
typedef enum { INSTANTIATED = 1, INITIALIZATION = 2, STEPPING = 4, TERMINATED = 8, FAILED = 16 } Phase;
static const char *const PHASE_NAME[] = {[INSTANTIATED] = "instantiated",
                                         [INITIALIZATION] = "in initialization mode",
                                         [STEPPING] = "initialized",
                                         [TERMINATED] = "terminated",
                                         [FAILED] = "failed"};
enum { READABLE = INITIALIZATION | STEPPING | TERMINATED | FAILED, ANY = 31, STATE_MAGIC = 0x636a3031 };

/* what an FMU state keeps */
typedef struct {
  uint32_t magic, size;
  Phase phase;
  Unit unit;
} Snapshot;

typedef struct {
  const fmi2CallbackFunctions *callbacks;
  char *name;
  bool debug;
  Phase phase;
  double stop_time; /* DBL_MAX: not defined */
  Unit start;       /* as instantiated: the table's start values, or those in resources/ */
  LateValues late;  /* from resources/, too */
  Unit unit;
} Instance;

static void say(const Instance *c, fmi2Status status, const char *category, const char *format, ...) {
  char text[512];
  va_list list;
  va_start(list, format);
  vsnprintf(text, sizeof text, format, list);
  va_end(list);
  if (c->callbacks->logger)
    c->callbacks->logger(c->callbacks->componentEnvironment, c->name, status, category, "%s", text);
}

#define FAIL(c, ...) return say((c), fmi2Error, "logStatusError", __VA_ARGS__), fmi2Error
#define NEEDS(phases)                                                                                                  \
  Instance *c = component;                                                                                             \
  if (!c) return fmi2Error;                                                                                            \
  if (!(c->phase & (phases))) FAIL(c, "%s is not allowed while the unit is %s", __func__, PHASE_NAME[c->phase])
#define NEEDS_POINTER(p)                                                                                               \
  if (!(p)) FAIL(c, "%s: argument " #p " is NULL", __func__)

/* ---- life ------------------------------------------------------------------------------------------------------ */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

static void set_starts(Unit *m) {
  memset(m, 0, sizeof *m);
  for (int i = 0; i < N_PUBLIC; i++) m->real[i] = REAL_INFO[i].start;
  for (int i = 1; i < N_INTEGER; i++) m->integer[i] = INTEGER_INFO[i].start;
  for (int i = 1; i < N_BOOLEAN; i++) m->boolean[i] = BOOLEAN_INFO[i].start;
  for (int j = 0; j < N_INPUT; j++) m->u[j].c[0] = m->real[FIRST_INPUT + j];
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
  char own[GUID_SIZE], why[256] = "";
  table_guid(own);
  set_starts(&probe.start);
  const StartFile file = read_start_values(&probe.start, &probe.late, resources, guid, why);
  if (file == START_BAD) REFUSE("fmi2Instantiate: %s", why);
  if (file != START_APPLIED && strcmp(guid, own) != 0)
    REFUSE("fmi2Instantiate: GUID %s given, this library is %s", guid, own);
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
  c->debug = debug != 0;
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
  for (size_t i = 0; i < n; i++)
    if (!categories[i] || (strcmp(categories[i], "logStatusError") != 0 && strcmp(categories[i], "logEvents") != 0))
      FAIL(c, "fmi2SetDebugLogging: category \"%s\" is unknown; there are logStatusError and logEvents",
           categories[i] ? categories[i] : "(null)");
  c->debug = on != 0;
  return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_given, fmi2Real stop) {
  NEEDS(INSTANTIATED);
  if (!isfinite(start)) FAIL(c, "fmi2SetupExperiment: startTime %g is not finite", start);
  if (tolerance_given && !(tolerance > 0 && tolerance <= 0.1))
    FAIL(c, "fmi2SetupExperiment: tolerance %g is outside 0 to 0.1", tolerance);
  if (stop_given && !(stop >= start)) FAIL(c, "fmi2SetupExperiment: stopTime %g lies before startTime %g", stop, start);
  c->unit.time = start;
  for (int j = 0; j < N_INPUT; j++) c->unit.u[j].t0 = start;
  if (tolerance_given) c->unit.tolerance = tolerance;
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
  evaluate(m, m->time);
  m->stale = 0;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
  NEEDS(INSTANTIATED);
  c->phase = INITIALIZATION;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
  NEEDS(INITIALIZATION);
  refresh(&c->unit);
#if defined UNIT_EVENTS
  if (!events_here(&c->unit)) { /* a unit may start on the far side of an event: in contact, say */
    c->phase = FAILED;
    FAIL(c, "fmi2ExitInitializationMode: events follow each other without end");
  }
#endif
  for (int i = 0; i < N_PUBLIC; i++)
    if (!isfinite(c->unit.real[i])) {
      char name[NAME_SIZE];
      c->phase = FAILED;
      FAIL(c, "fmi2ExitInitializationMode: %s is not finite; check the parameters",
           full_name(name, REAL_INFO[i].term, REAL_INFO[i].name));
    }
#if defined UNIT_SAMPLED
  unit_sample(&c->unit);
#endif
  c->phase = STEPPING;
  return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component) {
  NEEDS(STEPPING | FAILED);
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

/* ---- variables ------------------------------------------------------------------------------------------------- */

/* position of the first reference outside first..count-1, or n */
static size_t first_unknown(const fmi2ValueReference vr[], size_t n, size_t first, size_t count) {
  size_t i = 0;
  while (i < n && vr[i] >= first && vr[i] < count) i++;
  return i;
}

#define CHECK_LIST(first, count, what)                                                                                 \
  if (n > 0) NEEDS_POINTER(vr);                                                                                        \
  if (n > 0) NEEDS_POINTER(value);                                                                                     \
  const size_t bad = first_unknown(vr, n, first, count);                                                               \
  if (bad < n)                                                                                                         \
  FAIL(c, "%s: value reference %u is no " what " variable; they go from %d to %d", __func__, vr[bad], (int)(first),    \
       (int)(count) - 1)

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  NEEDS(ANY);
  CHECK_LIST(0, N_PUBLIC, "real");
  if (c->phase & (INITIALIZATION | STEPPING)) refresh(&c->unit);
  for (size_t i = 0; i < n; i++) value[i] = c->unit.real[vr[i]];
  return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
  NEEDS(ANY);
  CHECK_LIST(1, N_INTEGER, "integer");
  if (c->phase & (INITIALIZATION | STEPPING)) refresh(&c->unit);
  for (size_t i = 0; i < n; i++) value[i] = c->unit.integer[vr[i]];
  return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
  NEEDS(ANY);
  CHECK_LIST(1, N_BOOLEAN, "Boolean");
  if (c->phase & (INITIALIZATION | STEPPING)) refresh(&c->unit);
  for (size_t i = 0; i < n; i++) value[i] = c->unit.boolean[vr[i]];
  return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
  NEEDS(ANY);
  (void)value;
  if (n > 0) FAIL(c, "fmi2GetString: value reference %u: this unit has no string variables", vr ? vr[0] : 0);
  return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
  NEEDS(ANY);
  (void)value;
  if (n > 0) FAIL(c, "fmi2SetString: value reference %u: this unit has no string variables", vr ? vr[0] : 0);
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
  CHECK_LIST(0, N_PUBLIC, "real");
  char name[NAME_SIZE];
  for (size_t i = 0; i < n; i++) { /* all or nothing */
    const RealInfo *r = &REAL_INFO[vr[i]];
    if (r->kind == IS_OUTPUT || r->kind == IS_INTEGRAL || r->kind == IS_LOCAL)
      FAIL(c, "fmi2SetReal: %s is calculated by the unit and cannot be set", r->name);
    if (r->kind == IS_STATE && c->phase == STEPPING)
      FAIL(c, "fmi2SetReal: %s is a state; its start value can only be set before the initialization ends", r->name);
    if (!isfinite(value[i])) FAIL(c, "fmi2SetReal: %s = %g is not finite", full_name(name, r->term, r->name), value[i]);
    if (value[i] < r->min || value[i] > r->max)
      FAIL(c, "fmi2SetReal: %s = %g %s is outside %g to %g", full_name(name, r->term, r->name), value[i], r->unit,
           r->min, r->max);
  }
  Unit *m = &c->unit;
  for (size_t i = 0; i < n; i++) {
    const int j = (int)vr[i] - FIRST_INPUT;
    if (m->real[vr[i]] != value[i]) {
      m->real[vr[i]] = value[i];
      m->stale = 1;
      if (REAL_INFO[vr[i]].kind != IS_INPUT) m->restart = 1;
    }
    if (j >= 0 && j < N_INPUT) {
      m->u[j].t0 = m->time;
      m->u[j].c[0] = value[i];
      m->u[j].order = 0;
      m->u[j].fresh = 1;
    }
  }
  return fmi2OK;
}

static fmi2Status set_discrete(Instance *c, const char *call, int target[], const DiscreteInfo info[],
                               const fmi2ValueReference vr[], size_t n, const int value[]) {
  char name[NAME_SIZE];
  for (size_t i = 0; i < n; i++) {
    const DiscreteInfo *r = &info[vr[i]];
    const int max = r->options ? option_count(r->options) : r->max;
    if (r->kind == IS_OUTPUT) FAIL(c, "%s: %s is calculated by the unit and cannot be set", call, r->name);
    if (r->kind == IS_PARAMETER && c->phase == STEPPING)
      FAIL(c, "%s: %s is fixed once the unit is initialized", call, full_name(name, r->term, r->name));
    if (value[i] < r->min || value[i] > max)
      FAIL(c, "%s: %s = %d is outside %d to %d", call, full_name(name, r->term, r->name), value[i], r->min, max);
  }
  for (size_t i = 0; i < n; i++) {
    if (target[vr[i]] == value[i]) continue;
    target[vr[i]] = value[i];
    c->unit.stale = c->unit.restart = 1;
  }
  return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
  CHECK_LIST(1, N_INTEGER, "integer");
  return set_discrete(c, "fmi2SetInteger", c->unit.integer, INTEGER_INFO, vr, n, value);
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
  CHECK_LIST(1, N_BOOLEAN, "Boolean");
  return set_discrete(c, "fmi2SetBoolean", c->unit.boolean, BOOLEAN_INFO, vr, n, value);
}

/* ---- steps ----------------------------------------------------------------------------------------------------- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  NEEDS(INSTANTIATED | INITIALIZATION | STEPPING);
  CHECK_LIST(0, N_PUBLIC, "real");
  if (n > 0) NEEDS_POINTER(order);
  for (size_t i = 0; i < n; i++) {
    const RealInfo *r = &REAL_INFO[vr[i]];
    if (r->kind != IS_INPUT) FAIL(c, "fmi2SetRealInputDerivatives: %s is no input", r->name);
    if (order[i] < 1 || order[i] > INPUT_ORDER)
      FAIL(c, "fmi2SetRealInputDerivatives: order %d of %s; allowed are 1 to %d", order[i], r->name, INPUT_ORDER);
    if (!isfinite(value[i]))
      FAIL(c, "fmi2SetRealInputDerivatives: derivative %d of %s is %g", order[i], r->name, value[i]);
  }
  Unit *m = &c->unit;
  for (size_t i = 0; i < n; i++) {
    const int j = (int)vr[i] - FIRST_INPUT;
    if (m->u[j].order == 0 || !m->u[j].fresh) { /* the first derivative of a step wakes the others at zero */
      for (int k = 1; k <= INPUT_ORDER; k++) m->u[j].c[k] = 0;
      m->u[j].t0 = m->time;
      m->u[j].c[0] = m->real[vr[i]];
      m->u[j].order = 0;
      m->u[j].fresh = 1;
    }
    m->u[j].c[order[i]] = value[i];
    if (value[i] != 0 && m->u[j].order < order[i]) m->u[j].order = order[i];
  }
  return fmi2OK;
}

/* dy/dt = dg/dx dx/dt + dg/du du/dt + dg/dt, by a central difference along that direction */
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  NEEDS(STEPPING | TERMINATED);
  CHECK_LIST(0, N_PUBLIC, "real");
  if (n > 0) NEEDS_POINTER(order);
  Unit *m = &c->unit;
  refresh(m);
  bool all_states = true;
  for (size_t i = 0; i < n; i++) {
    if (order[i] != 1)
      FAIL(c, "fmi2GetRealOutputDerivatives: order %d of %s; allowed is 1", order[i], REAL_INFO[vr[i]].name);
    if (REAL_INFO[vr[i]].kind > IS_OUTPUT || REAL_INFO[vr[i]].kind == IS_INPUT)
      FAIL(c, "fmi2GetRealOutputDerivatives: %s is no output", REAL_INFO[vr[i]].name);
    all_states &= (int)vr[i] < N_X;
  }
  if (all_states) {
    for (size_t i = 0; i < n; i++) value[i] = m->real[FIRST_DER + vr[i]];
    return fmi2OK;
  }
  const double dt = 1e-6;
  Unit near = *m;
  for (int side = -1; side <= 1; side += 2) {
    for (int i = 0; i < N_X; i++) near.real[i] = m->real[i] + side * dt * m->real[FIRST_DER + i];
    evaluate(&near, m->time + side * dt);
    for (size_t i = 0; i < n; i++) {
      if ((int)vr[i] < N_X)
        value[i] = m->real[FIRST_DER + vr[i]];
      else
        value[i] = side < 0 ? near.real[vr[i]] : (near.real[vr[i]] - value[i]) / (2 * dt);
    }
  }
  return fmi2OK;
}

/* states, integrals, inputs and outputs are numbers */
static bool all_finite(const Unit *m) {
  bool lost = false;
  for (int i = 0; i < N_X + N_INPUT + N_OUTPUT; i++) lost |= !(fabs(m->real[i]) <= DBL_MAX);
  return !lost;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real t, fmi2Real h, fmi2Boolean no_rollback) {
  NEEDS(STEPPING);
  (void)no_rollback;
  Unit *m = &c->unit;
  const double slack = 1e-9 * fmax(1, fabs(t));
  if (!(h > 0) || !isfinite(h)) FAIL(c, "fmi2DoStep: communicationStepSize %g; it has to be positive", h);
  if (!(fabs(t - m->time) <= slack))
    FAIL(c, "fmi2DoStep: currentCommunicationPoint %.12g, but the unit is at %.12g", t, m->time);
  if (t + h > c->stop_time + slack)
    FAIL(c, "fmi2DoStep: the step ends at %g, behind the stop time %g", t + h, c->stop_time);
  if (apply_late(&c->late, m)) m->restart = 1;
  refresh(m);
  for (int j = 0; j < N_INPUT; j++) { /* an input that nobody set stays where it got to */
    if (!m->u[j].fresh) {
      m->u[j].c[0] = m->real[FIRST_INPUT + j];
      m->u[j].t0 = m->time;
      m->u[j].order = 0;
    }
    m->u[j].fresh = 0;
  }
  const char *trouble = integrate(m, t + h);
  if (!trouble && !all_finite(m)) trouble = "a variable left the range of numbers";
  if (trouble) {
    c->phase = FAILED;
    FAIL(c, "fmi2DoStep: from %g s by %g s: %s", t, h, trouble);
  }
#if defined UNIT_SAMPLED
  unit_sample(m);
#endif
  return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component component) {
  NEEDS(ANY);
  FAIL(c, "fmi2CancelStep: steps are finished when fmi2DoStep returns");
}

#define STATUS(type)                                                                                                   \
  fmi2Status fmi2Get##type##Status(fmi2Component component, const fmi2StatusKind kind, fmi2##type *value) {            \
    NEEDS(ANY);                                                                                                        \
    (void)value;                                                                                                       \
    FAIL(c, "fmi2Get" #type "Status: no status %d; steps are finished when fmi2DoStep returns", (int)kind);            \
  }
fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value) {
  NEEDS(ANY);
  (void)value;
  FAIL(c, "fmi2GetStatus: no status %d; steps are finished when fmi2DoStep returns", (int)kind);
}
STATUS(Integer)
STATUS(Boolean)
STATUS(String)
fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value) {
  NEEDS(STEPPING | TERMINATED | FAILED);
  NEEDS_POINTER(value);
  if (kind != fmi2LastSuccessfulTime)
    FAIL(c, "fmi2GetRealStatus: status %d; there is fmi2LastSuccessfulTime", (int)kind);
  *value = c->unit.time;
  return fmi2OK;
}

/* feed-through: d unknown / d known . dv, states held, by a central difference */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real dv[],
                                        fmi2Real dz[]) {
  NEEDS(INITIALIZATION | STEPPING | TERMINATED);
  if (n_unknown > 0) NEEDS_POINTER(unknown);
  if (n_unknown > 0) NEEDS_POINTER(dz);
  if (n_known > 0) NEEDS_POINTER(known);
  if (n_known > 0) NEEDS_POINTER(dv);
  refresh(&c->unit);
  for (size_t i = 0; i < n_unknown; i++)
    if (unknown[i] >= N_PUBLIC || REAL_INFO[unknown[i]].kind > IS_OUTPUT || REAL_INFO[unknown[i]].kind == IS_INPUT)
      FAIL(c, "fmi2GetDirectionalDerivative: unknown %u is no real output", unknown[i]);
  double length = 0;
  for (size_t j = 0; j < n_known; j++) {
    if (known[j] >= N_PUBLIC || REAL_INFO[known[j]].kind != IS_INPUT)
      FAIL(c, "fmi2GetDirectionalDerivative: known %u is no real input", known[j]);
    if (!isfinite(dv[j])) FAIL(c, "fmi2GetDirectionalDerivative: dv[%d] is not finite", (int)j);
    length = fmax(length, fabs(dv[j]) / REAL_INFO[known[j]].nominal);
  }
  const double eps = length > 0 ? 1e-6 / length : 0;
  Unit near = c->unit;
  for (int j = 0; j < N_INPUT; j++) near.u[j].order = 0;
  for (int side = -1; side <= 1; side += 2) {
    for (size_t j = 0; j < n_known; j++) near.real[known[j]] = c->unit.real[known[j]];
    for (size_t j = 0; j < n_known; j++) near.real[known[j]] += side * eps * dv[j];
    unit_equations(&near);
    for (size_t i = 0; i < n_unknown; i++)
      dz[i] = eps == 0 ? 0 : side < 0 ? near.real[unknown[i]] : (near.real[unknown[i]] - dz[i]) / (2 * eps);
  }
  return fmi2OK;
}

/* ---- FMU states ------------------------------------------------------------------------------------------------ */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  Snapshot *s = *state ? *state : malloc(sizeof *s);
  if (!s) FAIL(c, "fmi2GetFMUstate: out of memory");
  *s = (Snapshot){.magic = STATE_MAGIC, .size = sizeof *s, .phase = c->phase, .unit = c->unit};
  *state = s;
  return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  const Snapshot *s = state;
  if (s->magic != STATE_MAGIC || s->size != sizeof *s) FAIL(c, "fmi2SetFMUstate: this is no state of a %s", UNIT_NAME);
  c->phase = s->phase;
  c->unit = s->unit;
  return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
  NEEDS(ANY);
  if (!state) return fmi2OK;
  free(*state);
  *state = NULL;
  return fmi2OK;
}

/* bytes: GUID, then the snapshot; readable by the same build of the same unit */
fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(size);
  *size = GUID_SIZE + sizeof(Snapshot);
  return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  if (size < GUID_SIZE + sizeof(Snapshot))
    FAIL(c, "fmi2SerializeFMUstate: %u bytes given, %u needed", (unsigned)size,
         (unsigned)(GUID_SIZE + sizeof(Snapshot)));
  char guid[GUID_SIZE] = "";
  table_guid(guid);
  memcpy(bytes, guid, GUID_SIZE);
  memcpy(bytes + GUID_SIZE, state, sizeof(Snapshot));
  return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  NEEDS(ANY);
  NEEDS_POINTER(state);
  NEEDS_POINTER(bytes);
  char guid[GUID_SIZE] = "";
  table_guid(guid);
  Snapshot s;
  if (size < GUID_SIZE + sizeof s || memcmp(bytes, guid, GUID_SIZE) != 0)
    FAIL(c, "fmi2DeSerializeFMUstate: these %u bytes are no state of a %s %s", (unsigned)size, UNIT_NAME, guid);
  memcpy(&s, bytes + GUID_SIZE, sizeof s);
  if (s.magic != STATE_MAGIC || s.size != sizeof s || !(s.phase & ANY))
    FAIL(c, "fmi2DeSerializeFMUstate: the bytes are damaged");
  Snapshot *fresh = *state ? *state : malloc(sizeof s);
  if (!fresh) FAIL(c, "fmi2DeSerializeFMUstate: out of memory");
  *fresh = s;
  *state = fresh;
  return fmi2OK;
}
