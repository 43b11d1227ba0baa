/* Random sequences of FMI calls on one unit, for the sanitizers: any order, any value, several instances, states kept and swapped.
 *
 * program FIRST COUNT [THREADS]: sequences FIRST .. FIRST + COUNT - 1, each made of its number alone. UNIT_SOURCE is the unit's
 * sources/all.c, of FMI 2.0 or 3.0; calls_fmi2.h and calls_fmi3.h have what differs. A sequence that takes longer than LIMIT ends
 * the program, as what a sanitizer finds does; its number is printed. At the end it prints how many of the steps were taken. */
#include UNIT_SOURCE

#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <unistd.h>

enum { CALLS = 30, INSTANCES = 2, STATES = 3, LIMIT = 20 };

typedef struct {
  uint64_t x;
  void *c[INSTANCES];
  void *state[STATES];
  int owner[STATES];
  double time[INSTANCES];
  int stepping; /* the instance that takes a step: FMI 3.0 calls back */
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

static Reference any_of(Sequence *s, unsigned n) { return below(s, 20) ? below(s, n) : (unsigned)draw(s); }
static void states(Sequence *s, int i);

#ifdef fmi3Functions_h
#include "calls_fmi3.h"
#else
#include "calls_fmi2.h"
#endif

static void bytes_of(Sequence *s, void *c, int k) {
  size_t size = 0;
  if (!s->state[k] || StateSize(c, s->state[k], &size) != OK) return;
  Byte *bytes = malloc(size);
  if (bytes && SerializeState(c, s->state[k], bytes, size) == OK) {
    for (unsigned damage = below(s, 3); damage; damage--) bytes[below(s, (unsigned)size)] = (Byte)draw(s);
    void *again = NULL;
    if (DeserializeState(c, bytes, below(s, 8) ? size : below(s, (unsigned)size), &again) == OK) {
      SetState(c, again);
      FreeState(c, &again);
    }
  }
  free(bytes);
}

static void states(Sequence *s, int i) {
  void *c = s->c[i];
  int k = (int)below(s, STATES);
  if (s->state[k] && s->owner[k] != i) return; /* a state is its instance's: FMI 2.0.4, 2.1.8 */
  s->owner[k] = i;
  switch (below(s, 4)) {
    case 0: GetState(c, &s->state[k]); break;
    case 1:
      if (s->state[k]) SetState(c, s->state[k]);
      break;
    case 2:
      if (s->state[k]) FreeState(c, &s->state[k]);
      break;
    default: bytes_of(s, c, k); break;
  }
}

static void ready(Sequence *s, int i) {
  FMI(Reset)(s->c[i]), s->time[i] = 0;
  initialise(s->c[i]);
}

static void one_call(Sequence *s) {
  int i = (int)below(s, INSTANCES);
  void *c = s->c[i];
  const unsigned which = below(s, 24);
  const double h = any_step(s);
  if (which < 8)
    values(s, c);
  else if (which < 11)
    states(s, i);
  else if (which < 19) {
    const double t = below(s, 10) ? s->time[i] : any_value(s);
    const int status = step(s, i, t, h);
    asked++, taken += status == OK;
    if (status == REFUSED && below(s, 4)) ready(s, i); /* an error stays one: else hardly a step would follow */
  } else if (which == 19) {
    const double start = below(s, 2) ? 0 : any_value(s);
    if (set_up(s, c, start) == OK) s->time[i] = start;
  } else if (which == 20)
    enter_mode(s, c);
  else if (which == 21)
    FMI(ExitInitializationMode)(c);
  else if (which == 22)
    FMI(Terminate)(c);
  else if (FMI(Reset)(c) == OK)
    s->time[i] = 0;
}

static int sequence(unsigned long n) {
  Sequence s = {.x = 0x9E3779B97F4A7C15ULL * (n + 1)};
  number = n;
  for (int i = 0; i < INSTANCES; i++) {
    s.c[i] = instantiate(&s);
    if (!s.c[i]) return 1;
    if (below(&s, 4)) ready(&s, i); /* mostly ready to step: else hardly a sequence gets there */
  }
  for (int k = 0; k < CALLS; k++) one_call(&s);
  for (int k = 0; k < STATES; k++)
    if (s.state[k]) FreeState(s.c[s.owner[k]], &s.state[k]);
  for (int i = 0; i < INSTANCES; i++) FMI(FreeInstance)(s.c[i]);
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
