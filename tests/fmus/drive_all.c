/* A unit compiled into one program, for the sanitizers: two runs with every input moving and every term on, states stored,
 * restored and serialized, and the calls that must be refused. UNIT_SOURCE is the unit's sources/all.c. */
#include UNIT_SOURCE

#include <stdio.h>

static int messages;
static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String format, ...) {
  (void)e, (void)name, (void)status, (void)category, (void)format;
  messages++;
}
static const fmi2CallbackFunctions CALLBACKS = {logger, calloc, free, NULL, NULL};

#define OK(call)                                                                                                       \
  if ((call) != fmi2OK) return printf("%s:%d: " #call "\n", UNIT_NAME, __LINE__), 1
#define REFUSED(call)                                                                                                  \
  if ((call) != fmi2Error) return printf("%s:%d: accepted: " #call "\n", UNIT_NAME, __LINE__), 1

static int set_terms(fmi2Component c) {
  for (fmi2ValueReference vr = 0; vr < N_PUBLIC; vr++) {
    const RealInfo *r = &REAL_INFO[vr];
    if (r->kind != IS_PARAMETER || r->start != 0 || r->max > 100) continue;
    const double on = 0.01 * fmin(1, r->max);
    OK(fmi2SetReal(c, &vr, 1, &on));
  }
  return 0;
}

static int run(fmi2Component c, int steps) {
  for (int k = 0; k < steps; k++) {
    for (fmi2ValueReference vr = FIRST_INPUT; vr < FIRST_INPUT + N_INPUT; vr++) {
      const double nominal = REAL_INFO[vr].nominal, omega = 20 + vr, t = ((Instance *)c)->unit.time;
      const double u = fmax(lowest(vr), 0.3 * nominal * sin(omega * t)), du = 0.3 * nominal * omega * cos(omega * t);
      const fmi2Integer first = 1;
      OK(fmi2SetReal(c, &vr, 1, &u));
      OK(fmi2SetRealInputDerivatives(c, &vr, 1, &first, &du));
    }
    OK(fmi2DoStep(c, ((Instance *)c)->unit.time, 1e-3, fmi2True));
    double y;
    for (fmi2ValueReference vr = 0; vr < N_PUBLIC; vr++) OK(fmi2GetReal(c, &vr, 1, &y));
  }
  return 0;
}

int main(void) {
  for (int terms = 0; terms < 2; terms++) {
    fmi2Component c = fmi2Instantiate("sanitized", fmi2CoSimulation, UNIT_GUID, "file:///nowhere", &CALLBACKS, 0, 0);
    if (!c) return printf("%s does not instantiate\n", UNIT_NAME), 1;
    OK(fmi2SetupExperiment(c, 1, 1e-6, 0, 0, 0));
    OK(fmi2EnterInitializationMode(c));
    if (terms && set_terms(c)) return 1;
    OK(fmi2ExitInitializationMode(c));
    if (run(c, 200)) return 1;

    fmi2FMUstate state = NULL, copy = NULL;
    size_t size;
    OK(fmi2GetFMUstate(c, &state));
    OK(fmi2SerializedFMUstateSize(c, state, &size));
    fmi2Byte *bytes = malloc(size);
    OK(fmi2SerializeFMUstate(c, state, bytes, size));
    REFUSED(fmi2SerializeFMUstate(c, state, bytes, size - 1));
    OK(fmi2SetFMUstate(c, state)); /* from an error the way on is a kept state */
    OK(fmi2DeSerializeFMUstate(c, bytes, size, &copy));
    if (run(c, 50)) return 1;
    OK(fmi2SetFMUstate(c, copy));
    if (run(c, 50)) return 1;
    OK(fmi2FreeFMUstate(c, &state));
    OK(fmi2FreeFMUstate(c, &copy));
    free(bytes);

    const fmi2ValueReference unknown = 12345;
    double y = 0;
    REFUSED(fmi2GetReal(c, &unknown, 1, &y));
    REFUSED(fmi2SetReal(c, &unknown, 1, &y));
    REFUSED(fmi2DoStep(c, 99, 1e-3, fmi2True));
    REFUSED(fmi2Terminate(c)); /* an error stays one */
    OK(fmi2Reset(c));
    OK(fmi2SetupExperiment(c, 1, 1e-6, 0, 0, 0));
    OK(fmi2EnterInitializationMode(c));
    OK(fmi2ExitInitializationMode(c));
    OK(fmi2Terminate(c));
    OK(fmi2Reset(c));
    fmi2FreeInstance(c);
  }
  if (messages != 10) return printf("%s: %d messages, 10 expected\n", UNIT_NAME, messages), 1;
  return 0;
}
