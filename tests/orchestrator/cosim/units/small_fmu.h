/* The least FMI 2.0 co-simulation unit that does all that a master may ask for. Included once by each unit, which defines before:
 * STATES, REALS (value references, states first), INPUTS: bit mask of the Real inputs, SLOPES_AT_ONCE, and after: derivatives, outputs, step_status.
 * It may define ON(call, name), which is done at the head of some calls. */
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define UNUSED(x) (void)(x)
#ifndef ON
#define ON(call, name) UNUSED(name)
#endif

typedef struct {
  fmi2Real r[REALS];        /* index = value reference */
  fmi2Real slope[REALS][4]; /* inputs' derivatives by order */
  fmi2Integer n[4];
  fmi2Boolean b[4];
  fmi2Real time;
  bool initialising, stepped, stopped; /* stopped: asks the master to end */
} values;

typedef struct {
  values v;
  fmi2CallbackFunctions call;
  char name[64];
} unit;

static void start_values(values *v);
static void derivatives(const values *v, double *dx);
static void outputs(values *v);
static fmi2Status step_status(unit *m, double t, double h); /* before anything is done */

#define V(c) (&((unit *)(c))->v)

static bool is_input(size_t i) { return (INPUTS >> i) & 1; }

/* Inputs at time s of the step that begins with them at `from`. */
static void follow(values *v, const values *from, double s) {
  for (size_t i = 0; i < REALS; i++)
    if (is_input(i))
      v->r[i] = from->r[i] + s * (from->slope[i][1] + s * (from->slope[i][2] / 2 + s * from->slope[i][3] / 6));
}

static void advance(values *v, double h) {
  enum { N = 4 };
  values from = *v, z;
  double e = h / N, k[4][STATES + 1], x[STATES + 1];
  static const double at[4] = {0, 0.5, 0.5, 1};
  for (int q = 0; q < N; q++) {
    memcpy(x, v->r, STATES * sizeof *x);
    for (int stage = 0; stage < 4; stage++) {
      z = *v;
      for (int i = 0; i < STATES; i++) z.r[i] = x[i] + (stage ? at[stage] * e * k[stage - 1][i] : 0);
      follow(&z, &from, (q + at[stage]) * e);
      outputs(&z);
      derivatives(&z, k[stage]);
    }
    for (int i = 0; i < STATES; i++) v->r[i] = x[i] + e / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
  }
  follow(v, &from, h);
  outputs(v);
  v->time += h;
  v->stepped = true;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
  UNUSED(type), UNUSED(guid), UNUSED(resources), UNUSED(visible), UNUSED(logging);
  ON(Instantiate, name);
  unit *m = calloc(1, sizeof *m);
  if (!m) return NULL;
  m->call = *functions;
  strncpy(m->name, name, sizeof m->name - 1);
  start_values(&m->v);
  return m;
}

fmi2Status fmi2Reset(fmi2Component c) {
  *V(c) = (values){0};
  start_values(V(c));
  return fmi2OK;
}

void fmi2FreeInstance(fmi2Component c) {
  ON(FreeInstance, ((unit *)c)->name);
  free(c);
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
  UNUSED(has_tolerance), UNUSED(tolerance), UNUSED(has_stop), UNUSED(stop);
  ON(SetupExperiment, ((unit *)c)->name);
  V(c)->time = start;
  return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  ON(EnterInitializationMode, ((unit *)c)->name);
  V(c)->initialising = true;
  return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  ON(ExitInitializationMode, ((unit *)c)->name);
  outputs(V(c));
  V(c)->initialising = false;
  return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) {
  UNUSED(c);
  return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  ON(SetReal, ((unit *)c)->name);
  for (size_t i = 0; i < n; i++) {
    if (vr[i] >= REALS) return fmi2Error;
    V(c)->r[vr[i]] = value[i];
    memset(V(c)->slope[vr[i]], 0, sizeof V(c)->slope[0]);
  }
  return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  ON(GetReal, ((unit *)c)->name);
  if (V(c)->initialising) outputs(V(c));
  for (size_t i = 0; i < n; i++) {
    if (vr[i] >= REALS) return fmi2Error;
    value[i] = V(c)->r[vr[i]];
  }
  return fmi2OK;
}

#define ACCESS(Type, field)                                                                                            \
  fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[]) {       \
    for (size_t i = 0; i < n; i++) V(c)->field[vr[i] % 4] = value[i];                                                  \
    return fmi2OK;                                                                                                     \
  }                                                                                                                    \
  fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[]) {             \
    if (V(c)->initialising) outputs(V(c));                                                                             \
    for (size_t i = 0; i < n; i++) value[i] = V(c)->field[vr[i] % 4];                                                  \
    return fmi2OK;                                                                                                     \
  }
ACCESS(Integer, n)
ACCESS(Boolean, b)

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  for (size_t i = 0; i < n; i++) {
    if (vr[i] >= REALS || order[i] < 1 || order[i] > 3) return fmi2Error;
    V(c)->slope[vr[i]][order[i]] = value[i];
  }
  return fmi2OK;
}

/* by a central difference along the states' and the inputs' slopes at the end of the last step */
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  if (!V(c)->stepped && !SLOPES_AT_ONCE) return fmi2Discard; /* allowed: not known yet */
  const double e = 1e-6;
  values a = *V(c), b = a;
  double dx[STATES + 1];
  derivatives(V(c), dx);
  for (int i = 0; i < STATES; i++) a.r[i] += e * dx[i], b.r[i] -= e * dx[i];
  for (size_t i = 0; i < REALS; i++)
    if (is_input(i)) a.r[i] += e * a.slope[i][0], b.r[i] -= e * b.slope[i][0];
  outputs(&a), outputs(&b);
  for (size_t i = 0; i < n; i++) {
    if (vr[i] >= REALS || order[i] != 1) return fmi2Error;
    value[i] = (a.r[vr[i]] - b.r[vr[i]]) / (2 * e);
  }
  return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean keeps_no_state) {
  UNUSED(keeps_no_state);
  if (t > 0.05) ON(DoStep, ((unit *)c)->name);
  fmi2Status status = step_status(c, t, h);
  if (status != fmi2OK && status != fmi2Warning) return status;
  if (fabs(t - V(c)->time) > 1e-9) return fmi2Error; /* a master that lost count */
  values *v = V(c);
  v->time = t;
  advance(v, h);
  for (size_t i = 0; i < REALS; i++) /* slope[0]: at the end of the step */
    v->slope[i][0] = v->slope[i][1] + h * (v->slope[i][2] + h * v->slope[i][3] / 2);
  return status;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  ON(GetFMUstate, ((unit *)c)->name);
  if (!*state) *state = malloc(sizeof(values));
  if (!*state) return fmi2Error;
  memcpy(*state, V(c), sizeof(values));
  return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  memcpy(V(c), state, sizeof(values));
  return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  UNUSED(c);
  free(*state);
  *state = NULL;
  return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  *value = kind == fmi2Terminated && V(c)->stopped;
  return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

/* FMPy loads a library only if it has them all; no test calls these. */
#define WITHOUT(name, ...)                                                                                             \
  fmi2Status name(__VA_ARGS__) { return fmi2Error; }
#pragma GCC diagnostic ignored "-Wunused-parameter"
WITHOUT(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
WITHOUT(fmi2GetString, fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
WITHOUT(fmi2SetString, fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
WITHOUT(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size)
WITHOUT(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
WITHOUT(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
WITHOUT(fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
        const fmi2ValueReference known[], size_t n_known, const fmi2Real d_known[], fmi2Real d_unknown[])
WITHOUT(fmi2CancelStep, fmi2Component c)
WITHOUT(fmi2GetStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
WITHOUT(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
WITHOUT(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
WITHOUT(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
