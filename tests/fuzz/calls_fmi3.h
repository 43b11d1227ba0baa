/* FMI 3.0: what sequences.c draws from. EXCHANGE: of model exchange. */
#define FMI(name) fmi3##name
#define GetState fmi3GetFMUState
#define SetState fmi3SetFMUState
#define FreeState fmi3FreeFMUState
#define StateSize fmi3SerializedFMUStateSize
#define SerializeState fmi3SerializeFMUState
#define DeserializeState fmi3DeserializeFMUState
typedef fmi3Byte Byte;

static void logger(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category, fmi3String text) {
  (void)e, (void)status, (void)category, (void)text;
}

/* n <= 2; in event mode */
static void clocks(Sequence *s, void *c, size_t n) {
  const fmi3ValueReference vr[2] = {FMI3_CLOCK + any_of(s, N_CLOCK + 1), FMI3_CLOCK + any_of(s, N_CLOCK + 1)};
  fmi3Clock b[2] = {below(s, 2) == 0, true};
  if (below(s, 3))
    fmi3GetClock(c, vr, n, b);
  else
    fmi3SetClock(c, vr, n, b);
}

static void values(Sequence *s, void *c) {
  fmi3ValueReference vr[4], discrete[4];
  fmi3Int32 n[4], order[4];
  fmi3Int64 choice[4];
  fmi3Boolean b[4];
  const size_t many = below(s, 5), counted = below(s, 10) ? many : below(s, 5);
  double *x = malloc(counted * sizeof *x), *seed = malloc(counted * sizeof *seed); /* no longer than the unit is told */
  for (size_t k = 0; k < counted; k++) x[k] = any_value(s), seed[k] = any_value(s);
  for (size_t k = 0; k < 4; k++) {
    vr[k] = below(s, 9) ? any_of(s, FIRST_DER + N_STATE + 1) : FMI3_INDICATOR + any_of(s, N_EVENT + 1);
    discrete[k] = FMI3_INTEGER + any_of(s, N_INTEGER + N_BOOLEAN);
    n[k] = (int)below(s, 7) - 3, order[k] = (int)below(s, 4) - 1, b[k] = below(s, 2) == 0;
    choice[k] = below(s, 4) ? n[k] : (fmi3Int64)(draw(s) << 11);
  }
  switch (below(s, 13)) {
    case 0: fmi3GetFloat64(c, vr, many, x, counted); break;
    case 1:
    case 2: fmi3SetFloat64(c, vr, many, x, counted); break;
    case 3: fmi3GetInt32(c, discrete, many, n, counted); break;
    case 4: fmi3SetInt32(c, discrete, many, n, counted); break;
    case 5: fmi3GetInt64(c, discrete, many, choice, counted); break;
    case 6: fmi3SetInt64(c, discrete, many, choice, counted); break;
    case 7: fmi3GetBoolean(c, discrete, many, b, counted); break;
    case 8: fmi3SetBoolean(c, discrete, many, b, counted); break;
    case 9: fmi3GetString(c, vr, many, NULL, counted); break;
    case 10: clocks(s, c, below(s, 3)); break;
    case 11: fmi3GetOutputDerivatives(c, vr, many, order, x, counted); break;
    default: fmi3GetDirectionalDerivative(c, vr, many, discrete, below(s, 2), seed, counted, x, counted); break;
  }
  free(x), free(seed);
}

static int update(void *c) {
  fmi3Boolean b[5];
  double next;
  return (int)fmi3UpdateDiscreteStates(c, &b[0], &b[1], &b[2], &b[3], &b[4], &next);
}

/* within a step: what a master may do there and, rarely, what it must not */
static void look_within(fmi3InstanceEnvironment environment, fmi3Float64 t, fmi3Boolean set, fmi3Boolean get,
                        fmi3Boolean finished, fmi3Boolean may_end, fmi3Boolean *end, fmi3Float64 *end_time) {
  (void)set, (void)get, (void)finished, (void)may_end;
  Sequence *s = environment;
  if (!below(s, 50)) values(s, s->c[s->stepping]);
  if (!below(s, 500)) states(s, s->stepping);
  if (!below(s, 500)) fmi3Reset(s->c[s->stepping]);
  *end = !below(s, 20), *end_time = below(s, 2) ? t : any_value(s);
}

#ifdef EXCHANGE
static void *instantiate(Sequence *s) {
  return fmi3InstantiateModelExchange("fuzzed", UNIT_GUID, NULL, 0, below(s, 2), s, logger);
}

static void initialise(void *c) {
  fmi3EnterInitializationMode(c, 0, 0, 0, 0, 0), fmi3ExitInitializationMode(c);
  fmi3EnterContinuousTimeMode(c);
}

static void enter_mode(Sequence *s, void *c) {
  switch (below(s, 4)) {
    case 0: fmi3EnterEventMode(c); break;
    case 1: update(c); break;
    case 2: fmi3EnterStepMode(c); break;
    default: fmi3EnterContinuousTimeMode(c); break;
  }
}

static size_t about(Sequence *s, size_t n) { return below(s, 60) ? n : below(s, (unsigned)n + 1); }

/* Euler's, and event mode behind it; lengths are wrong now and then */
static int step(Sequence *s, int i, double t, double h) {
  void *c = s->c[i];
  double x[N_X + 1], der[N_X + 1], z[N_EVENT + 1];
  fmi3Boolean enter = 0, terminate = 0;
  int status = (int)fmi3SetTime(c, t + h);
  status |= (int)fmi3GetContinuousStateDerivatives(c, der, about(s, N_X));
  status |= (int)fmi3GetContinuousStates(c, x, about(s, N_X));
  for (int k = 0; status == OK && k < N_X; k++) x[k] += below(s, 50) ? h * der[k] : any_value(s);
  if (status == OK) status = (int)fmi3SetContinuousStates(c, x, about(s, N_X));
  status |= (int)fmi3GetEventIndicators(c, z, about(s, N_EVENT));
  status |= (int)fmi3CompletedIntegratorStep(c, 1, &enter, &terminate);
  if (status == OK && below(s, 3) == 0) {
    fmi3EnterEventMode(c), values(s, c);
    if (N_CLOCK > 0 && below(s, 4) == 0) clocks(s, c, 1);
    status = update(c);
    status |= (int)fmi3EnterContinuousTimeMode(c);
  }
  if (below(s, 10) == 0) fmi3GetNominalsOfContinuousStates(c, x, about(s, N_X));
  if (status == OK) s->time[i] = t + h;
  return status;
}
#else
static void *instantiate(Sequence *s) {
  const bool events = N_EVENT > 0 && below(s, 2);
  return fmi3InstantiateCoSimulation("fuzzed", UNIT_GUID, NULL, 0, below(s, 2), events, below(s, 2), NULL, 0, s, logger,
                                     below(s, 2) ? look_within : NULL);
}

static void initialise(void *c) {
  fmi3EnterInitializationMode(c, 0, 0, 0, 0, 0), fmi3ExitInitializationMode(c);
  if (((Fmi3Instance *)c)->event_mode) fmi3EnterStepMode(c);
}

static void enter_mode(Sequence *s, void *c) {
  switch (below(s, 3)) {
    case 0: fmi3EnterEventMode(c); break;
    case 1: update(c); break;
    default: fmi3EnterStepMode(c); break;
  }
}

static int step(Sequence *s, int i, double t, double h) {
  fmi3Boolean event, terminate, early;
  double last;
  s->stepping = i;
  const fmi3Status status = fmi3DoStep(s->c[i], t, h, below(s, 2), &event, &terminate, &early, &last);
  if (status == fmi3OK) s->time[i] = last;
  if (status == fmi3OK && event && below(s, 2)) {
    fmi3EnterEventMode(s->c[i]);
    if (N_CLOCK > 0 && below(s, 4) == 0) clocks(s, s->c[i], 1);
    update(s->c[i]);
    fmi3EnterStepMode(s->c[i]);
  }
  return (int)status;
}

#endif

static int set_up(Sequence *s, void *c, double start) {
  return (int)fmi3EnterInitializationMode(c, below(s, 2) == 0, fabs(any_value(s)), start, below(s, 2) == 0,
                                          any_value(s));
}
