/* FMI 2.0 for co-simulation and model exchange: the core's functions by the names and types of the standard.
 * One translation unit per FMU: EQUATIONS names the unit's equations.c, MODEL_DEF its table, UNIT_GUID is its GUID. */
#include "core/core.h"
#include "core/vector_field.h"
#include "fmi2Functions.h"

typedef struct {
  Instance core;
  const fmi2CallbackFunctions *callbacks;
  bool exchange; /* model exchange: the master integrates */
} Fmi2Instance;

static void fmi2_log(const Instance *c, Status status, const char *category, const char *text) {
  const fmi2CallbackFunctions *callbacks = ((const Fmi2Instance *)c)->callbacks;
  if (callbacks->logger)
    callbacks->logger(callbacks->componentEnvironment, c->name, (fmi2Status)status, category, "%s", text);
}

/* the call as the core has it, in the phases in which the standard allows it */
#define CALL(phases, done) return enter(component, __func__, (phases)) != OK ? fmi2Error : (fmi2Status)(done)
enum {
  SETTABLE = INSTANTIATED | INITIALIZATION | STEPPING | EVENT, /* in continuous-time mode: real inputs alone */
  SOLVED = STEPPING | TERMINATED | STOPPED_SHORT,
  EXCHANGED = EVENT | CONTINUOUS
};

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean debug) {
  (void)visible;
  if (!callbacks) return NULL;
  Fmi2Instance c = {.core = {.log = fmi2_log, .call = __func__, .log_events = debug != 0},
                    .callbacks = callbacks,
                    .exchange = type == fmi2ModelExchange};
  if (c.exchange && no_model_exchange() && name && *name) {
    c.core.name = (char *)name;
    say(&c.core, REFUSED, "logStatusError", "only co-simulation is offered: %s", no_model_exchange());
    return NULL;
  }
  return new_instance(&c.core, sizeof c, name, guid, resources);
}

void fmi2FreeInstance(fmi2Component component) { free_instance(component); }

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  CALL(ANY, set_logging(component, on != 0, n, categories));
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_given, fmi2Real stop) {
  CALL(INSTANTIATED, set_experiment(component, tolerance_given ? &tolerance : NULL, start, stop_given ? &stop : NULL));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) { CALL(INSTANTIATED, go(component, INITIALIZATION)); }

static Status exit_initialization(Fmi2Instance *c) {
  const Status status = end_initialization(&c->core);
  return status == OK && c->exchange ? go(&c->core, EVENT) : status;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component component) { CALL(INITIALIZATION, exit_initialization(component)); }
fmi2Status fmi2Terminate(fmi2Component component) {
  CALL(STEPPING | STOPPED_SHORT | EXCHANGED, go(component, TERMINATED));
}
fmi2Status fmi2Reset(fmi2Component component) { CALL(ANY, reset(component)); }

/* ---- variables ------------------------------------------------------------------------------------------------- */
fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  CALL(READABLE, get_reals(component, vr, n, value));
}
fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  CALL(SETTABLE | CONTINUOUS, set_reals(component, vr, n, value));
}

static Status get_integers(Instance *c, const Reference vr[], size_t n, int value[]) {
  CHECK_LIST(1, N_INTEGER, "integer");
  const Status status = bring_up_to_date(c);
  for (size_t i = 0; status == OK && i < n; i++) value[i] = integers(&c->unit)[vr[i]];
  return status;
}
static Status get_booleans(Instance *c, const Reference vr[], size_t n, int value[]) {
  CHECK_LIST(1, N_BOOLEAN, "Boolean");
  const Status status = bring_up_to_date(c);
  for (size_t i = 0; status == OK && i < n; i++) value[i] = booleans(&c->unit)[vr[i]];
  return status;
}
fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
  CALL(READABLE, get_integers(component, vr, n, value));
}
fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
  CALL(READABLE, get_booleans(component, vr, n, value));
}

static Status set_discrete(Instance *c, int variables[], const DiscreteInfo info[], const Reference vr[], size_t n,
                           const int value[]) {
  Status status = OK;
  for (size_t i = 0; status == OK && i < n; i++) status = check_discrete(c, &info[vr[i]], value[i]);
  for (size_t i = 0; status == OK && i < n; i++) put_discrete(&c->unit, &variables[vr[i]], value[i]);
  return status;
}
static Status set_integers(Instance *c, const Reference vr[], size_t n, const int value[]) {
  CHECK_LIST(1, N_INTEGER, "integer");
  return set_discrete(c, integers(&c->unit), INTEGER_INFO, vr, n, value);
}
static Status set_booleans(Instance *c, const Reference vr[], size_t n, const int value[]) {
  CHECK_LIST(1, N_BOOLEAN, "Boolean");
  return set_discrete(c, booleans(&c->unit), BOOLEAN_INFO, vr, n, value);
}
fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
  CALL(SETTABLE, set_integers(component, vr, n, value));
}
fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
  CALL(SETTABLE, set_booleans(component, vr, n, value));
}

static Status no_strings(Instance *c, const Reference vr[], size_t n) {
  if (n > 0) FAIL(c, "value reference %u: this unit has no string variables", vr ? vr[0] : 0);
  return OK;
}
fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
  (void)value;
  CALL(READABLE, no_strings(component, vr, n));
}
fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
  (void)value;
  CALL(ANY, no_strings(component, vr, n));
}

/* ---- steps ----------------------------------------------------------------------------------------------------- */
fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  CALL(SETTABLE & ~EVENT, set_input_derivatives(component, vr, n, order, value));
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  CALL(SOLVED, output_derivatives(component, vr, n, order, value));
}
fmi2Status fmi2DoStep(fmi2Component component, fmi2Real t, fmi2Real h, fmi2Boolean no_rollback) {
  (void)no_rollback;
  CALL(STEPPING, do_step(component, t, h, NULL));
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real dv[],
                                        fmi2Real dz[]) {
  CALL(INITIALIZATION | SOLVED | EXCHANGED,
       directional_derivative(component, unknown, n_unknown, known, n_known, dv, dz));
}

static Status never_runs(Instance *c) { FAIL(c, "steps are finished when fmi2DoStep returns"); }
fmi2Status fmi2CancelStep(fmi2Component component) { CALL(ANY, never_runs(component)); }

static Status no_status(Instance *c, int kind) {
  DISCARD(c, "no status %d; steps are finished when fmi2DoStep returns", kind);
}
#define STATUS(type)                                                                                                   \
  fmi2Status fmi2Get##type##Status(fmi2Component component, const fmi2StatusKind kind, fmi2##type *value) {            \
    (void)value;                                                                                                       \
    CALL(ANY, no_status(component, (int)kind));                                                                        \
  }
STATUS(Integer)
STATUS(String)
fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value) {
  (void)value;
  CALL(ANY, no_status(component, (int)kind));
}

/* a unit never wants a simulation to end: a step that it could not finish is the master's to judge */
static Status wants_end(Instance *c, fmi2StatusKind kind, fmi2Boolean *value) {
  NEEDS_POINTER(value);
  if (kind != fmi2Terminated) DISCARD(c, "status %d; there is fmi2Terminated", (int)kind);
  *value = fmi2False;
  return OK;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
  CALL(ANY, wants_end(component, kind, value));
}
static Status last_time(Instance *c, fmi2StatusKind kind, fmi2Real *value) {
  NEEDS_POINTER(value);
  if (kind != fmi2LastSuccessfulTime) DISCARD(c, "status %d; there is fmi2LastSuccessfulTime", (int)kind);
  *value = c->unit.time;
  return OK;
}
fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value) {
  CALL(SOLVED | FAILED, last_time(component, kind, value));
}

/* ---- model exchange -------------------------------------------------------------------------------------------- */
fmi2Status fmi2EnterEventMode(fmi2Component component) { CALL(EXCHANGED, go(component, EVENT)); }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component component) { CALL(EVENT, go(component, CONTINUOUS)); }

static Status tell_discrete_states(Instance *c, fmi2EventInfo *info) {
  NEEDS_POINTER(info);
  bool moved = false;
  const Status status = new_discrete_states(c, &moved);
  const double next = next_time_event(c);
  *info = (fmi2EventInfo){.valuesOfContinuousStatesChanged = moved,
                          .nextEventTimeDefined = isfinite(next),
                          .nextEventTime = isfinite(next) ? next : 0};
  return status;
}
fmi2Status fmi2NewDiscreteStates(fmi2Component component, fmi2EventInfo *info) {
  CALL(EVENT, tell_discrete_states(component, info));
}

static Status step_completed(Instance *c, fmi2Boolean *enter_event_mode, fmi2Boolean *terminate) {
  NEEDS_POINTER(enter_event_mode);
  NEEDS_POINTER(terminate);
  *enter_event_mode = *terminate = fmi2False;
  return OK;
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component component, fmi2Boolean no_rollback, fmi2Boolean *enter_event_mode,
                                       fmi2Boolean *terminate) {
  (void)no_rollback;
  CALL(CONTINUOUS, step_completed(component, enter_event_mode, terminate));
}
fmi2Status fmi2SetTime(fmi2Component component, fmi2Real t) { CALL(EXCHANGED, set_time(component, t)); }
fmi2Status fmi2SetContinuousStates(fmi2Component component, const fmi2Real x[], size_t n) {
  CALL(CONTINUOUS, set_continuous_states(component, x, n));
}
fmi2Status fmi2GetContinuousStates(fmi2Component component, fmi2Real x[], size_t n) {
  CALL(INITIALIZATION | EXCHANGED | TERMINATED, get_continuous_states(component, x, n));
}
fmi2Status fmi2GetDerivatives(fmi2Component component, fmi2Real der[], size_t n) {
  CALL(EXCHANGED | TERMINATED, get_derivatives(component, der, n));
}
fmi2Status fmi2GetEventIndicators(fmi2Component component, fmi2Real z[], size_t n) {
  CALL(INITIALIZATION | EXCHANGED | TERMINATED, get_event_indicators(component, z, n));
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component component, fmi2Real nominal[], size_t n) {
  CALL(INSTANTIATED | EXCHANGED | TERMINATED, get_nominals(component, nominal, n));
}

/* ---- states ---------------------------------------------------------------------------------------------------- */
fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) { CALL(ANY, get_state(component, state)); }

static Status set_own_state(Fmi2Instance *c, const Snapshot *state) {
  if (state && is_state(state) && state->phase & (c->exchange ? STEPPING | STOPPED_SHORT : EXCHANGED))
    FAIL(&c->core, "this state is of an instance for %s", c->exchange ? "co-simulation" : "model exchange");
  return set_state(&c->core, state);
}
fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) { CALL(ANY, set_own_state(component, state)); }
fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) { CALL(ANY, free_state(state)); }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size) {
  CALL(ANY, serialized_size(component, state, size));
}
fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  CALL(ANY, serialize_state(component, state, bytes, size));
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  CALL(ANY, deserialize_state(component, bytes, size, state));
}
#undef CALL

#if !defined FMI2_FUNCTION_PREFIX /* linked with others, it would need a name of its own */
/* beside FMI: core/field.h */
FMI2_Export const VectorField *cobot_joint_field(void);
const VectorField *cobot_joint_field(void) { return &VECTOR_FIELD; }
#endif
