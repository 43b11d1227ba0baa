/* The least an FMI 2.0 co-simulation unit can be: a row of reals and one function. Included once by each unit. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

typedef struct {
  fmi2Real real[REALS]; /* index = value reference */
  fmi2Real time;
  char *resources;
  void *data;
} unit;

static bool start(unit *m);   /* at the end of initialisation */
static void advance(unit *m); /* m->time has been moved to the end of the step */

#define UNUSED(x) (void)(x)

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  UNUSED(c), UNUSED(on), UNUSED(n), UNUSED(categories);
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
  UNUSED(name), UNUSED(guid), UNUSED(functions), UNUSED(visible), UNUSED(logging);
  unit *m = type == fmi2CoSimulation ? calloc(1, sizeof *m) : NULL;
  if (m && resources) {
    /* file:///path, file:/path or, from some masters, file://localhost/path */
    const char *path = strncmp(resources, "file:", 5) == 0 ? resources + 5 : resources;
    while (path[0] == '/' && path[1] == '/') path++;
    m->resources = malloc(strlen(path) + 1);
    if (m->resources) strcpy(m->resources, path);
  }
  return m;
}

void fmi2FreeInstance(fmi2Component c) {
  unit *m = c;
  if (m) {
    free(m->resources);
    free(m->data);
    free(m);
  }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
  UNUSED(toleranceDefined), UNUSED(tolerance), UNUSED(stopTimeDefined), UNUSED(stopTime);
  ((unit *)c)->time = startTime;
  return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return start(c) ? fmi2OK : fmi2Error; }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  advance(c);
  return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
  UNUSED(c);
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
  unit *m = c;
  memset(m->real, 0, sizeof m->real);
  m->time = 0.0;
  return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  for (size_t j = 0; j < n; j++) {
    if (vr[j] >= REALS) return fmi2Error;
    value[j] = ((unit *)c)->real[vr[j]];
  }
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  for (size_t j = 0; j < n; j++) {
    if (vr[j] >= REALS) return fmi2Error;
    ((unit *)c)->real[vr[j]] = value[j];
  }
  return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noSetPrior) {
  UNUSED(noSetPrior);
  ((unit *)c)->time = time + step;
  advance(c);
  return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c) {
  UNUSED(c);
  return fmi2Error;
}

/* Only reals, no states, no derivatives: an empty request is fine, any other is an error. */
#define NONE(n) return (n) == 0 ? fmi2OK : fmi2Error
#define GET_SET(Type)                                                                                                  \
  fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[]) {             \
    UNUSED(c), UNUSED(vr), UNUSED(value);                                                                              \
    NONE(n);                                                                                                           \
  }                                                                                                                    \
  fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[]) {       \
    UNUSED(c), UNUSED(vr), UNUSED(value);                                                                              \
    NONE(n);                                                                                                           \
  }
GET_SET(Integer)
GET_SET(Boolean)
GET_SET(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  UNUSED(c), UNUSED(state);
  return fmi2Error;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  UNUSED(c), UNUSED(state);
  return fmi2Error;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  UNUSED(c), UNUSED(state);
  return fmi2Error;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
  UNUSED(c), UNUSED(state), UNUSED(size);
  return fmi2Error;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  UNUSED(c), UNUSED(state), UNUSED(bytes), UNUSED(size);
  return fmi2Error;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  UNUSED(c), UNUSED(bytes), UNUSED(size), UNUSED(state);
  return fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[]) {
  UNUSED(c), UNUSED(unknown), UNUSED(unknowns), UNUSED(known), UNUSED(knowns), UNUSED(dvKnown), UNUSED(dvUnknown);
  return fmi2Error;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  UNUSED(c), UNUSED(vr), UNUSED(order), UNUSED(value);
  NONE(n);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  UNUSED(c), UNUSED(vr), UNUSED(order), UNUSED(value);
  NONE(n);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
  UNUSED(c), UNUSED(kind), UNUSED(value);
  return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  UNUSED(c), UNUSED(kind), UNUSED(value);
  return fmi2Discard;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
  UNUSED(c), UNUSED(kind), UNUSED(value);
  return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  UNUSED(c), UNUSED(kind), UNUSED(value);
  return fmi2Discard;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
  UNUSED(c), UNUSED(kind), UNUSED(value);
  return fmi2Discard;
}

/* model exchange is not offered, but fmuloader wants every function of the standard in a library */
fmi2Status fmi2EnterEventMode(fmi2Component c) { return UNUSED(c), fmi2Error; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return UNUSED(c), fmi2Error; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) { return UNUSED(c), UNUSED(info), fmi2Error; }
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) { return UNUSED(c), UNUSED(t), fmi2Error; }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_rollback, fmi2Boolean *event,
                                       fmi2Boolean *terminate) {
  return UNUSED(c), UNUSED(no_rollback), UNUSED(event), UNUSED(terminate), fmi2Error;
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
  return UNUSED(c), UNUSED(x), UNUSED(n), fmi2Error;
}
#define NO_VECTOR(name)                                                                                                \
  fmi2Status name(fmi2Component c, fmi2Real value[], size_t n) {                                                       \
    return UNUSED(c), UNUSED(value), UNUSED(n), fmi2Error;                                                             \
  }
NO_VECTOR(fmi2GetDerivatives)
NO_VECTOR(fmi2GetEventIndicators)
NO_VECTOR(fmi2GetContinuousStates)
NO_VECTOR(fmi2GetNominalsOfContinuousStates)
