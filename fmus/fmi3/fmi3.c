/* FMI 3.0 for co-simulation: the core's functions by the names and types of the standard; event mode, intermediate update and
 * early return are the core's watch on a step. Model exchange is in exchange.h, clocks in clocks.h, what no unit has (arrays,
 * strings) in absent.h.
 * One translation unit per FMU: EQUATIONS names the unit's equations.c, MODEL_DEF its table, UNIT_GUID is its GUID. */
#include <limits.h>

#include "core/core.h"
#include "fmi3/references.h"
#include "fmi3Functions.h"

typedef struct {
  Instance core;
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log_message;
  fmi3IntermediateUpdateCallback intermediate_update;
  bool logging, event_mode, early_return;
  bool exchange; /* model exchange: the master integrates */
} Fmi3Instance;

static void fmi3_log(const Instance *core, Status status, const char *category, const char *text) {
  const Fmi3Instance *c = (const Fmi3Instance *)core;
  if (c->logging && c->log_message) c->log_message(c->environment, (fmi3Status)status, category, text);
}

/* the call as the core has it, in the phases in which the standard allows it */
#define CALL(phases, done) return enter(instance, __func__, (phases)) != OK ? fmi3Error : (fmi3Status)(done)
#define VALUES(n)                                                                                                      \
  if (n_values != (n)) FAIL(c, "%u values for %u scalar variables", (unsigned)n_values, (unsigned)(n))
enum {
  FMI3_SETTABLE = INSTANTIATED | INITIALIZATION | STEPPING | EVENT | INTERMEDIATE,
  FMI3_SOLVED = STEPPING | TERMINATED | EVENT,
  FMI3_EXCHANGED = EVENT | CONTINUOUS
};

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message,
                                         fmi3IntermediateUpdateCallback intermediate_update) {
  (void)visible, (void)required, (void)n_required; /* every variable can be had within a step */
  Fmi3Instance c = {.core = {.log = fmi3_log, .call = __func__, .log_events = logging},
                    .environment = environment,
                    .log_message = log_message,
                    .intermediate_update = intermediate_update,
                    .logging = true, /* why there is no instance is told in any case */
                    .event_mode = event_mode,
                    .early_return = early_return};
  if (event_mode && N_EVENT == 0) {
    say(&c.core, REFUSED, "logStatusError", "%s has no event mode", UNIT_NAME);
    return NULL;
  }
  Fmi3Instance *fresh = new_instance(&c.core, sizeof c, name, token, resources);
  if (fresh) fresh->logging = logging;
  return fresh;
}

void fmi3FreeInstance(fmi3Instance instance) { free_instance(instance); }

static Status set_debug_logging(Fmi3Instance *c, bool on, size_t n, const fmi3String categories[]) {
  if (on || n == 0) c->logging = on;
  return set_logging(&c->core, on, n, categories);
}
fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) {
  CALL(ANY, set_debug_logging(instance, on, n, categories));
}

static Status begin_initialization(Instance *c, const double *tolerance, double start, const double *stop) {
  const Status status = set_experiment(c, tolerance, start, stop);
  return status == OK ? go(c, INITIALIZATION) : status;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_given, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_given, fmi3Float64 stop) {
  CALL(INSTANTIATED,
       begin_initialization(instance, tolerance_given ? &tolerance : NULL, start, stop_given ? &stop : NULL));
}

static Status initialized(Fmi3Instance *c) {
  const Status status = end_initialization(&c->core);
  return status == OK && (c->event_mode || c->exchange) ? go(&c->core, EVENT) : status;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) { CALL(INITIALIZATION, initialized(instance)); }
fmi3Status fmi3Terminate(fmi3Instance instance) { CALL(STEPPING | FMI3_EXCHANGED, go(instance, TERMINATED)); }
fmi3Status fmi3Reset(fmi3Instance instance) { CALL(ANY, reset(instance)); }

/* ---- variables ------------------------------------------------------------------------------------------------- */
static inline bool is_indicator(Reference vr) { return vr >= FMI3_INDICATOR && vr < FMI3_INDICATOR + N_EVENT; }
static double indicator(Instance *c, Reference vr) {
  double z[N_EVENT1] = {0};
  if (c->phase & ~(INSTANTIATED | FAILED)) get_event_indicators(c, z, N_EVENT);
  return z[vr - FMI3_INDICATOR];
}
static Status get_floats(Instance *c, const Reference vr[], size_t n, double value[], size_t n_values) {
  VALUES(n);
  if (n > 0) NEEDS_POINTER(vr);
  if (n > 0) NEEDS_POINTER(value);
  for (size_t i = 0; i < n; i++)
    if (vr[i] >= N_REAL && vr[i] != FMI3_TIME && !is_indicator(vr[i]))
      FAIL(c, "value reference %u is no Float64 variable; they go from 0 to %d, %d is time, indicators follow %d",
           vr[i], N_REAL - 1, FMI3_TIME, FMI3_INDICATOR - 1);
  const Status status = bring_up_to_date(c);
  for (size_t i = 0; status == OK && i < n; i++)
    value[i] = vr[i] == FMI3_TIME ? c->unit.time : is_indicator(vr[i]) ? indicator(c, vr[i]) : reals(&c->unit)[vr[i]];
  return status;
}
static Status set_floats(Instance *c, const Reference vr[], size_t n, const double value[], size_t n_values) {
  VALUES(n);
  return set_reals(c, vr, n, value);
}
fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[],
                          size_t n_values) {
  CALL(READABLE | INSTANTIATED, get_floats(instance, vr, n, value, n_values));
}
fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t n_values) {
  CALL(FMI3_SETTABLE | CONTINUOUS, set_floats(instance, vr, n, value, n_values));
}

typedef enum { IS_INT32, IS_ENUMERATION, IS_BOOLEAN } DiscreteType;

/* the variable and its row; NULL: the reference is of another type */
static int *discrete_variable(Unit *m, DiscreteType type, Reference vr, const DiscreteInfo **r) {
  const Reference i = vr - FMI3_INTEGER, b = vr - FMI3_BOOLEAN;
  if (type == IS_BOOLEAN) {
    if (b < 1 || b >= N_BOOLEAN) return NULL;
    *r = &BOOLEAN_INFO[b];
    return &booleans(m)[b];
  }
  if (i < 1 || i >= N_INTEGER || (INTEGER_INFO[i].options != NULL) != (type == IS_ENUMERATION)) return NULL;
  *r = &INTEGER_INFO[i];
  return &integers(m)[i];
}

static inline int as_int(int64_t value) { return value > INT_MAX ? INT_MAX : value < INT_MIN ? INT_MIN : (int)value; }

/* FMI 3.0: Enumerations are read and set as Int64 */
#define DISCRETE_VARIABLES(Type, type)                                                                                 \
  static Status get_##Type(Instance *c, const Reference vr[], size_t n, fmi3##Type value[], size_t n_values) {         \
    VALUES(n);                                                                                                         \
    if (n > 0) NEEDS_POINTER(vr);                                                                                      \
    if (n > 0) NEEDS_POINTER(value);                                                                                   \
    const Status status = bring_up_to_date(c);                                                                         \
    const DiscreteInfo *r;                                                                                             \
    for (size_t i = 0; status == OK && i < n; i++) {                                                                   \
      const int *variable = discrete_variable(&c->unit, type, vr[i], &r);                                              \
      if (!variable) FAIL(c, "value reference %u is no variable of this type", vr[i]);                                 \
      value[i] = (fmi3##Type) * variable;                                                                              \
    }                                                                                                                  \
    return status;                                                                                                     \
  }                                                                                                                    \
  static Status set_##Type(Instance *c, const Reference vr[], size_t n, const fmi3##Type value[], size_t n_values) {   \
    VALUES(n);                                                                                                         \
    if (n > 0) NEEDS_POINTER(vr);                                                                                      \
    if (n > 0) NEEDS_POINTER(value);                                                                                   \
    const DiscreteInfo *r;                                                                                             \
    for (size_t i = 0; i < n; i++) {                                                                                   \
      if (!discrete_variable(&c->unit, type, vr[i], &r))                                                               \
        FAIL(c, "value reference %u is no variable of this type", vr[i]);                                              \
      const Status status = check_discrete(c, r, as_int(value[i]));                                                    \
      if (status != OK) return status;                                                                                 \
    }                                                                                                                  \
    for (size_t i = 0; i < n; i++)                                                                                     \
      put_discrete(&c->unit, discrete_variable(&c->unit, type, vr[i], &r), as_int(value[i]));                          \
    return OK;                                                                                                         \
  }                                                                                                                    \
  fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3##Type value[],         \
                           size_t n_values) {                                                                          \
    CALL(READABLE | INSTANTIATED, get_##Type(instance, vr, n, value, n_values));                                       \
  }                                                                                                                    \
  fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3##Type value[],   \
                           size_t n_values) {                                                                          \
    CALL(FMI3_SETTABLE, set_##Type(instance, vr, n, value, n_values));                                                 \
  }
DISCRETE_VARIABLES(Int32, IS_INT32)
DISCRETE_VARIABLES(Int64, IS_ENUMERATION)
DISCRETE_VARIABLES(Boolean, IS_BOOLEAN)

/* ---- steps ----------------------------------------------------------------------------------------------------- */
typedef struct {
  Watch watch;
  Fmi3Instance *c;
} Fmi3Watch;

/* Intermediate update: everything may be read, inputs may be set and then stay, and the step may end here or soon. */
static void intermediate_update(Watch *watch, double t) {
  Fmi3Instance *c = ((Fmi3Watch *)watch)->c;
  Unit *m = &c->core.unit;
  const char *call = c->core.call;
  fmi3Boolean end = fmi3False;
  fmi3Float64 end_time = t;
  m->stale = 1; /* outputs that only a reader needs */
  go(&c->core, INTERMEDIATE);
  c->intermediate_update(c->environment, t, fmi3True, fmi3True, fmi3True, c->early_return, &end, &end_time);
  c->core.call = call;
  if (c->core.phase == INTERMEDIATE)
    go(&c->core, STEPPING);
  else
    watch->until = t; /* a call in it was refused, and so is the step */
  refresh(m);
  for (int j = 0; j < N_INPUT; j++) m->u[j].fresh = 0;
  if (end && c->early_return) watch->until = fmin(watch->until, fmax(t, end_time));
}

static Status take_step(Fmi3Instance *c, double t, double h, fmi3Boolean *event, fmi3Boolean *terminate,
                        fmi3Boolean *early, fmi3Float64 *last) {
  Instance *core = &c->core;
  if (!event || !terminate || !early || !last) FAIL(core, "a pointer to a result is NULL");
  Fmi3Watch w = {.watch = {.step_finished = c->intermediate_update ? intermediate_update : NULL,
                           .at_events = c->event_mode && c->early_return,
                           .until = t + h},
                 .c = c};
  const bool watched = w.watch.step_finished || w.watch.at_events;
  Status status = do_step(core, t, h, watched ? &w.watch : NULL);
  if (core->phase == FAILED) status = REFUSED;
  if (status == DISCARDED) go(core, STEPPING); /* a master may go on from lastSuccessfulTime */
  *event = w.watch.event_due;
  *terminate = fmi3False; /* a unit never wants a simulation to end */
  *early = status == OK && w.watch.until < t + h;
  *last = core->unit.time;
  return status;
}
fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_rollback, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
  (void)no_rollback;
  CALL(STEPPING, take_step(instance, t, h, event, terminate, early, last));
}

static Status enter_event_mode(Fmi3Instance *c) {
  if (c->core.phase == STEPPING && !c->event_mode) FAIL(&c->core, "the unit was instantiated without event mode");
  return go(&c->core, EVENT);
}
fmi3Status fmi3EnterEventMode(fmi3Instance instance) { CALL(STEPPING | CONTINUOUS, enter_event_mode(instance)); }

static Status enter_step_mode(Fmi3Instance *c) {
  if (c->exchange) FAIL(&c->core, "only for co-simulation");
  return go(&c->core, STEPPING);
}
fmi3Status fmi3EnterStepMode(fmi3Instance instance) { CALL(EVENT, enter_step_mode(instance)); }

static Status update_discrete(Fmi3Instance *c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
                              fmi3Boolean *states, fmi3Boolean *next_defined, fmi3Float64 *next) {
  Instance *core = &c->core;
  if (!again || !terminate || !nominals || !states || !next_defined || !next)
    FAIL(core, "a pointer to a result is NULL");
  *again = *terminate = *nominals = *next_defined = fmi3False;
  *next = INFINITY;
  if (!c->exchange) return update_discrete_states(core, states);
  const Status status = new_discrete_states(core, states);
  *next = next_time_event(core);
  *next_defined = isfinite(*next);
  return status;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *next_defined,
                                    fmi3Float64 *next) {
  CALL(EVENT, update_discrete(instance, again, terminate, nominals, states, next_defined, next));
}

static Status get_output_derivatives(Instance *c, const Reference vr[], size_t n, const int order[], double value[],
                                     size_t n_values) {
  VALUES(n);
  if (((Fmi3Instance *)c)->exchange) FAIL(c, "only for co-simulation");
  return output_derivatives(c, vr, n, order, value);
}
fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                    const fmi3Int32 order[], fmi3Float64 value[], size_t n_values) {
  CALL(FMI3_SOLVED | INTERMEDIATE, get_output_derivatives(instance, vr, n, order, value, n_values));
}

static Status get_directional_derivative(Instance *c, const Reference unknown[], size_t n_unknown,
                                         const Reference known[], size_t n_known, const double seed[], size_t n_seed,
                                         double sensitivity[], size_t n_sensitivity) {
  if (n_seed != n_known || n_sensitivity != n_unknown)
    FAIL(c, "%u seeds for %u scalar knowns, %u sensitivities for %u scalar unknowns", (unsigned)n_seed,
         (unsigned)n_known, (unsigned)n_sensitivity, (unsigned)n_unknown);
  return directional_derivative(c, unknown, n_unknown, known, n_known, seed, sensitivity);
}
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknown[], size_t n_unknown,
                                        const fmi3ValueReference known[], size_t n_known, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
  CALL(INITIALIZATION | FMI3_SOLVED | CONTINUOUS,
       get_directional_derivative(instance, unknown, n_unknown, known, n_known, seed, n_seed, sensitivity,
                                  n_sensitivity));
}

/* ---- states ---------------------------------------------------------------------------------------------------- */
fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) { CALL(ANY, get_state(instance, state)); }
static Status set_own_state3(Fmi3Instance *c, const Snapshot *state) {
  /* an event is one of either kind, but for an instance without event mode */
  const int others = c->exchange ? STEPPING | STOPPED_SHORT : c->event_mode ? CONTINUOUS : FMI3_EXCHANGED;
  if (state && is_state(state) && state->phase & others)
    FAIL(&c->core, "this state is of an instance for %s", c->exchange ? "co-simulation" : "model exchange");
  return set_state(&c->core, state);
}
fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) { CALL(ANY, set_own_state3(instance, state)); }
fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) { CALL(ANY, free_state(state)); }
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
  CALL(ANY, serialized_size(instance, state, size));
}
fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  CALL(ANY, serialize_state(instance, state, bytes, size));
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
  CALL(ANY, deserialize_state(instance, bytes, size, state));
}

#include "fmi3/exchange.h"

#include "fmi3/clocks.h"

#include "fmi3/absent.h"
#undef CALL
