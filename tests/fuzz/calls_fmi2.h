/* FMI 2.0: what sequences.c draws from. */
#define FMI(name) fmi2##name
#define GetState fmi2GetFMUstate
#define SetState fmi2SetFMUstate
#define FreeState fmi2FreeFMUstate
#define StateSize fmi2SerializedFMUstateSize
#define SerializeState fmi2SerializeFMUstate
#define DeserializeState fmi2DeSerializeFMUstate
typedef fmi2Byte Byte;

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String format, ...) {
  (void)e, (void)name, (void)status, (void)category, (void)format;
}
static const fmi2CallbackFunctions CALLBACKS = {logger, calloc, free, NULL, NULL};

static void *instantiate(Sequence *s) {
  (void)s;
  return fmi2Instantiate("fuzzed", fmi2CoSimulation, UNIT_GUID, "file:///nowhere", &CALLBACKS, 0, 0);
}

static void values(Sequence *s, fmi2Component c) {
  fmi2ValueReference vr[4];
  fmi2Real x[4];
  fmi2Integer n[4], order[4];
  fmi2Boolean b[4];
  const size_t many = below(s, 5);
  for (size_t k = 0; k < many; k++) {
    vr[k] = any_of(s, N_PUBLIC), x[k] = any_value(s), n[k] = (int)below(s, 7) - 3, order[k] = (int)below(s, 6) - 1;
    b[k] = (int)below(s, 3);
  }
  switch (below(s, 9)) {
    case 0: fmi2GetReal(c, vr, many, x); break;
    case 1: fmi2SetReal(c, vr, many, x); break;
    case 2: fmi2SetInteger(c, vr, many, n); break;
    case 3: fmi2GetInteger(c, vr, many, n); break;
    case 4: fmi2SetBoolean(c, vr, many, b); break;
    case 5: fmi2GetBoolean(c, vr, many, b); break;
    case 6: fmi2SetRealInputDerivatives(c, vr, many, order, x); break;
    case 7: fmi2GetRealOutputDerivatives(c, vr, many, order, x); break;
    default: fmi2GetDirectionalDerivative(c, vr, many / 2, vr + many / 2, many - many / 2, x, x + 2); break;
  }
}

static void initialise(void *c) {
  fmi2SetupExperiment(c, 0, 0, 0, 0, 0), fmi2EnterInitializationMode(c), fmi2ExitInitializationMode(c);
}

static int step(Sequence *s, int i, double t, double h) {
  const fmi2Status status = fmi2DoStep(s->c[i], t, h, (int)below(s, 2));
  if (status == fmi2OK) s->time[i] += h;
  return (int)status;
}

static int set_up(Sequence *s, void *c, double start) {
  return (int)fmi2SetupExperiment(c, below(s, 2) == 0, fabs(any_value(s)), start, below(s, 2) == 0, any_value(s));
}

static void enter_mode(Sequence *s, void *c) {
  (void)s;
  fmi2EnterInitializationMode(c);
}
