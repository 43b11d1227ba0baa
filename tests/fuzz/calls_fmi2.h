/* FMI 2.0: what sequences.c draws from. EXCHANGE: of model exchange. */
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

#ifdef EXCHANGE
enum { KIND = fmi2ModelExchange };
#else
enum { KIND = fmi2CoSimulation };
#endif

static void *instantiate(Sequence *s) {
  (void)s;
  return fmi2Instantiate("fuzzed", KIND, UNIT_GUID, "file:///nowhere", &CALLBACKS, 0, 0);
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
#ifdef EXCHANGE
  fmi2EnterContinuousTimeMode(c);
#endif
}

#ifdef EXCHANGE
static size_t about(Sequence *s, size_t n) { return below(s, 60) ? n : below(s, (unsigned)n + 1); }

/* Euler's, and event mode behind it; lengths are wrong now and then */
static int step(Sequence *s, int i, double t, double h) {
  void *c = s->c[i];
  double x[N_X + 1], der[N_X + 1], z[N_EVENT + 1];
  fmi2EventInfo info;
  fmi2Boolean enter = 0, terminate = 0;
  int status = (int)fmi2SetTime(c, t + h);
  status |= (int)fmi2GetDerivatives(c, der, about(s, N_X)) | (int)fmi2GetContinuousStates(c, x, about(s, N_X));
  for (int k = 0; status == OK && k < N_X; k++) x[k] += below(s, 50) ? h * der[k] : any_value(s);
  if (status == OK) status = (int)fmi2SetContinuousStates(c, x, about(s, N_X));
  status |= (int)fmi2GetEventIndicators(c, z, about(s, N_EVENT));
  status |= (int)fmi2CompletedIntegratorStep(c, 1, &enter, &terminate);
  if (status == OK && below(s, 3) == 0) {
    fmi2EnterEventMode(c), values(s, c);
    status = (int)fmi2NewDiscreteStates(c, &info) | (int)fmi2EnterContinuousTimeMode(c);
  }
  if (below(s, 10) == 0) fmi2GetNominalsOfContinuousStates(c, x, about(s, N_X));
  if (status == OK) s->time[i] = t + h;
  return status;
}
#else
static int step(Sequence *s, int i, double t, double h) {
  const fmi2Status status = fmi2DoStep(s->c[i], t, h, (int)below(s, 2));
  if (status == fmi2OK) s->time[i] += h;
  return (int)status;
}
#endif

static int set_up(Sequence *s, void *c, double start) {
  return (int)fmi2SetupExperiment(c, below(s, 2) == 0, fabs(any_value(s)), start, below(s, 2) == 0, any_value(s));
}

static void enter_mode(Sequence *s, void *c) {
  (void)s;
  fmi2EnterInitializationMode(c);
}
