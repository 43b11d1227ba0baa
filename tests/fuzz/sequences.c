/* Random sequences of FMI calls on one unit, for the sanitizers: any order, any value, several instances, states kept and swapped.
 *
 * program FIRST COUNT [THREADS]: sequences FIRST .. FIRST + COUNT - 1, each made of its number alone. UNIT_SOURCE is the unit's
 * sources/all.c. A sequence that takes longer than LIMIT ends the program, as what a sanitizer finds does; its number is printed.
 * At the end it prints how many of the steps were taken. */
#include UNIT_SOURCE

#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <unistd.h>

enum { CALLS = 30, INSTANCES = 2, STATES = 3, LIMIT = 20 };

typedef struct {
  uint64_t x;
  fmi2Component c[INSTANCES];
  fmi2FMUstate state[STATES];
  int owner[STATES];
  double time[INSTANCES];
} Sequence;

static _Thread_local unsigned long number;
static void print_number(void) { fprintf(stderr, "%s: sequence %lu\n", UNIT_NAME, number); }
void __sanitizer_set_death_callback(void (*callback)(void));

static unsigned long first, count, threads, at;
static atomic_ulong asked, taken; /* steps */
static void too_long(int unused) {
  (void)unused;
  fprintf(stderr, "%s: a sequence up to %lu takes more than %d s\n", UNIT_NAME, at, LIMIT);
  _exit(3);
}

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String format, ...) {
  (void)e, (void)name, (void)status, (void)category, (void)format;
}
static const fmi2CallbackFunctions CALLBACKS = {logger, calloc, free, NULL, NULL};

static uint64_t draw(Sequence *s) { /* xorshift64*, Vigna 2016 */
  s->x ^= s->x >> 12, s->x ^= s->x << 25, s->x ^= s->x >> 27;
  return s->x * 0x2545F4914F6CDD1DULL >> 11;
}
static unsigned below(Sequence *s, unsigned n) { return (unsigned)(draw(s) % n); }
static double unit_draw(Sequence *s) { return (double)draw(s) / 9007199254740992.0; }

static double any_value(Sequence *s) {
  static const double odd[] = {0,      -0.0, 1,        -1,        1e-300, -1e-300, 1e300,
                               -1e300, NAN,  INFINITY, -INFINITY, 1e9,    -1e9,    5e-324};
  return below(s, 3) ? 4 * unit_draw(s) - 2 : odd[below(s, sizeof odd / sizeof *odd)];
}

static double any_step(Sequence *s) {
  static const double odd[] = {0, -1e-3, NAN, INFINITY, -INFINITY, 1e-12, 0.05};
  return below(s, 4) ? 1e-3 * unit_draw(s) : odd[below(s, sizeof odd / sizeof *odd)];
}

static fmi2ValueReference any_variable(Sequence *s) { return below(s, 20) ? below(s, N_PUBLIC) : (unsigned)draw(s); }

static void values(Sequence *s, fmi2Component c) {
  fmi2ValueReference vr[4];
  fmi2Real x[4];
  fmi2Integer n[4], order[4];
  fmi2Boolean b[4];
  const size_t many = below(s, 5);
  for (size_t k = 0; k < many; k++) {
    vr[k] = any_variable(s), x[k] = any_value(s), n[k] = (int)below(s, 7) - 3, order[k] = (int)below(s, 6) - 1;
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

static void bytes_of(Sequence *s, fmi2Component c, int k) {
  size_t size = 0;
  if (!s->state[k] || fmi2SerializedFMUstateSize(c, s->state[k], &size) != fmi2OK) return;
  fmi2Byte *bytes = malloc(size);
  if (bytes && fmi2SerializeFMUstate(c, s->state[k], bytes, size) == fmi2OK) {
    for (unsigned damage = below(s, 3); damage; damage--) bytes[below(s, (unsigned)size)] = (fmi2Byte)draw(s);
    fmi2FMUstate again = NULL;
    if (fmi2DeSerializeFMUstate(c, bytes, below(s, 8) ? size : below(s, (unsigned)size), &again) == fmi2OK) {
      fmi2SetFMUstate(c, again);
      fmi2FreeFMUstate(c, &again);
    }
  }
  free(bytes);
}

static void states(Sequence *s, int i) {
  fmi2Component c = s->c[i];
  int k = (int)below(s, STATES);
  if (s->state[k] && s->owner[k] != i) return; /* a state is its instance's: FMI 2.0.4, 2.1.8 */
  s->owner[k] = i;
  switch (below(s, 4)) {
    case 0: fmi2GetFMUstate(c, &s->state[k]); break;
    case 1:
      if (s->state[k]) fmi2SetFMUstate(c, s->state[k]);
      break;
    case 2:
      if (s->state[k]) fmi2FreeFMUstate(c, &s->state[k]);
      break;
    default: bytes_of(s, c, k); break;
  }
}

static void ready(Sequence *s, int i) {
  fmi2Reset(s->c[i]), s->time[i] = 0;
  fmi2SetupExperiment(s->c[i], 0, 0, 0, 0, 0), fmi2EnterInitializationMode(s->c[i]),
      fmi2ExitInitializationMode(s->c[i]);
}

static void one_call(Sequence *s) {
  int i = (int)below(s, INSTANCES);
  fmi2Component c = s->c[i];
  const unsigned which = below(s, 24);
  const double h = any_step(s);
  if (which < 8)
    values(s, c);
  else if (which < 11)
    states(s, i);
  else if (which < 19) {
    const double t = below(s, 10) ? s->time[i] : any_value(s);
    const fmi2Status status = fmi2DoStep(c, t, h, (int)below(s, 2));
    asked++, taken += status == fmi2OK;
    if (status == fmi2OK) s->time[i] += h;
    if (status == fmi2Error && below(s, 4)) ready(s, i); /* an error stays one: else hardly a step would follow */
  } else if (which == 19) {
    const double start = below(s, 2) ? 0 : any_value(s);
    if (fmi2SetupExperiment(c, below(s, 2) == 0, fabs(any_value(s)), start, below(s, 2) == 0, any_value(s)) == fmi2OK)
      s->time[i] = start;
  } else if (which == 20)
    fmi2EnterInitializationMode(c);
  else if (which == 21)
    fmi2ExitInitializationMode(c);
  else if (which == 22)
    fmi2Terminate(c);
  else if (fmi2Reset(c) == fmi2OK)
    s->time[i] = 0;
}

static int sequence(unsigned long n) {
  Sequence s = {.x = 0x9E3779B97F4A7C15ULL * (n + 1)};
  number = n;
  for (int i = 0; i < INSTANCES; i++) {
    s.c[i] = fmi2Instantiate("fuzzed", fmi2CoSimulation, UNIT_GUID, "file:///nowhere", &CALLBACKS, 0, 0);
    if (!s.c[i]) return 1;
    if (below(&s, 4)) ready(&s, i); /* mostly ready to step: else hardly a sequence gets there */
  }
  for (int k = 0; k < CALLS; k++) one_call(&s);
  for (int k = 0; k < STATES; k++)
    if (s.state[k]) fmi2FreeFMUstate(s.c[s.owner[k]], &s.state[k]);
  for (int i = 0; i < INSTANCES; i++) fmi2FreeInstance(s.c[i]);
  return 0;
}

static void *every_nth(void *begin) {
  for (unsigned long n = (unsigned long)(uintptr_t)begin; n < first + count; n += threads) {
    if (threads == 1) at = n, alarm(LIMIT);
    if (sequence(n)) return begin;
  }
  return NULL;
}

int main(int argc, char **argv) {
  if (argc < 3) return 2;
  first = strtoul(argv[1], NULL, 10), count = strtoul(argv[2], NULL, 10);
  threads = argc > 3 ? strtoul(argv[3], NULL, 10) : 1;
  signal(SIGALRM, too_long);
  __sanitizer_set_death_callback(print_number);
  pthread_t all[64];
  for (unsigned long k = 0; k < threads; k++)
    if (pthread_create(&all[k], NULL, every_nth, (void *)(uintptr_t)(first + k))) return 2;
  int failed = 0;
  for (unsigned long k = 0; k < threads; k++) {
    void *result = NULL;
    pthread_join(all[k], &result);
    failed |= result != NULL;
  }
  printf("%s: %lu of %lu steps taken\n", UNIT_NAME, taken, asked);
  return failed;
}
