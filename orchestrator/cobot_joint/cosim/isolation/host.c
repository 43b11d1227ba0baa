/* The process of one isolated unit: opens its library, carries out the calls that come through the channel, ends with its parent.
 *
 * cosim_host LIBRARY MEMORY_LIMIT (bytes); the channel and the lifeline are open already (channel.h). */
#include "channel.h"

#include <dlfcn.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include "fmi2FunctionTypes.h"

static Channel *channel;
static fmi2Component component;
static fmi2FMUstate *states; /* by number, from 1 on */
static uint32_t n_states;

static struct {
#define POINTER(name) fmi2##name##TYPE *name;
  CALLS(POINTER)
} unit;

static const char *const names[] = {
#define NAME(name) "fmi2" #name,
    CALLS(NAME)};

static void keep_said(fmi2Status status, const char *format, va_list arguments) {
  channel->said_status = status;
  vsnprintf(channel->said, sizeof channel->said, format, arguments);
}

static void say(fmi2Status status, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  keep_said(status, format, arguments);
  va_end(arguments);
}

static void logger(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
  (void)environment, (void)instance, (void)category;
  if (!message || status == fmi2OK) return;
  va_list arguments;
  va_start(arguments, message);
  keep_said(status, message, arguments);
  va_end(arguments);
}

static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};

/* Arrays of a command, one after the other */
typedef struct {
  const char *at;
} Reader;
static const void *next(Reader *r, size_t size) {
  const void *found = r->at;
  r->at += padded(size);
  return found;
}
static const char *next_string(Reader *r) { return next(r, strlen(r->at) + 1); }

static fmi2Status instantiate(const Command *c, Reader r) {
  const char *name = next_string(&r), *guid = next_string(&r), *resources = next_string(&r);
  component =
      unit.Instantiate(name, fmi2CoSimulation, guid, resources, &callbacks, (fmi2Boolean)c->n, (fmi2Boolean)c->m);
  return component ? fmi2OK : fmi2Error;
}

static fmi2Status setup(const Command *c) {
  return unit.SetupExperiment(component, c->n & 1, c->real[0], c->real[1], (c->n & 2) != 0, c->real[2]);
}

static fmi2Status set_strings(const Command *c, const fmi2ValueReference *refs, Reader r) {
  for (uint32_t k = 0; k < c->n; k++) {
    fmi2String text = next_string(&r);
    fmi2Status status = unit.SetString(component, refs + k, 1, &text);
    if (status > fmi2Warning) return status;
  }
  return fmi2OK;
}

/* one string */
static fmi2Status get_string(const fmi2ValueReference *refs, char *values) {
  fmi2String text = "";
  fmi2Status status = unit.GetString(component, refs, 1, &text);
  snprintf(values, SAID, "%s", text ? text : "");
  return status;
}

static fmi2Status keep_state(uint32_t number) {
  if (number >= n_states) {
    fmi2FMUstate *more = realloc(states, (number + 1) * sizeof *states);
    if (!more) return fmi2Error;
    for (states = more; n_states <= number; n_states++) states[n_states] = NULL;
  }
  return unit.GetFMUstate(component, &states[number]);
}

static fmi2Status derivatives(const Command *c, Reader r, double *values) {
  const fmi2ValueReference *unknown = next(&r, c->n * sizeof *unknown), *known = next(&r, c->m * sizeof *known);
  return unit.GetDirectionalDerivative(component, unknown, c->n, known, c->m, next(&r, c->m * sizeof *values), values);
}

static fmi2Status call(const Command *c, void *values) {
  Reader r = {(const char *)(c + 1)};
  if (c->call == CALL_Instantiate) return instantiate(c, r);
  if (c->call == CALL_SetupExperiment) return setup(c);
  if (c->call == CALL_GetDirectionalDerivative) return derivatives(c, r, values);
  bool variables = (c->call >= CALL_SetReal && c->call <= CALL_GetRealOutputDerivatives);
  const fmi2ValueReference *refs = variables ? next(&r, c->n * sizeof *refs) : NULL;
  switch (c->call) {
    case CALL_FreeInstance: return unit.FreeInstance(component), fmi2OK;
    case CALL_Reset: return unit.Reset(component);
    case CALL_EnterInitializationMode: return unit.EnterInitializationMode(component);
    case CALL_ExitInitializationMode: return unit.ExitInitializationMode(component);
    case CALL_Terminate: return unit.Terminate(component);
    case CALL_SetReal: return unit.SetReal(component, refs, c->n, next(&r, 0));
    case CALL_SetInteger: return unit.SetInteger(component, refs, c->n, next(&r, 0));
    case CALL_SetBoolean: return unit.SetBoolean(component, refs, c->n, next(&r, 0));
    case CALL_SetString: return set_strings(c, refs, r);
    case CALL_GetReal: return unit.GetReal(component, refs, c->n, values);
    case CALL_GetInteger: return unit.GetInteger(component, refs, c->n, values);
    case CALL_GetBoolean: return unit.GetBoolean(component, refs, c->n, values);
    case CALL_GetString: return get_string(refs, values);
    case CALL_SetRealInputDerivatives: {
      const fmi2Integer *orders = next(&r, c->n * sizeof *orders);
      return unit.SetRealInputDerivatives(component, refs, c->n, orders, next(&r, 0));
    }
    case CALL_GetRealOutputDerivatives:
      return unit.GetRealOutputDerivatives(component, refs, c->n, next(&r, 0), values);
    case CALL_DoStep: return unit.DoStep(component, c->real[0], c->real[1], (fmi2Boolean)c->n);
    case CALL_GetBooleanStatus: return unit.GetBooleanStatus(component, (fmi2StatusKind)c->n, values);
    case CALL_GetFMUstate: return keep_state(c->state);
    case CALL_SetFMUstate: return unit.SetFMUstate(component, states[c->state]);
    case CALL_FreeFMUstate: return unit.FreeFMUstate(component, &states[c->state]);
    default: return fmi2Error;
  }
}

static bool is_there(int32_t id) {
  void *pointers[N_CALLS];
  memcpy(pointers, &unit, sizeof unit);
  return pointers[id] != NULL;
}

static void carry_out(void) {
  channel->refused = -1;
  channel->said_status = 0;
  const Command *c;
  for (uint32_t at = 0; at < channel->n_in; at += c->size) {
    c = (const Command *)(channel->in + at);
    Answer *answer = (Answer *)(channel->out + c->reply);
    atomic_store(&channel->call, c->call);
    if (is_there(c->call)) {
      answer->status = call(c, answer + 1);
    } else {
      say(fmi2Error, "the library has no %s", names[c->call]);
      answer->status = fmi2Error;
    }
    answer->done = 1;
    if (answer->status > fmi2Warning) {
      if (!c->ahead) channel->refused = c->call;
      return;
    }
  }
}

static void open_library(const char *path) {
  void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    say(fmi2Error, "%s", dlerror());
    return;
  }
  void *pointers[N_CALLS];
  for (int k = 0; k < N_CALLS; k++) pointers[k] = dlsym(library, names[k]);
  memcpy(&unit, pointers, sizeof unit);
  channel->opened = unit.Instantiate && unit.FreeInstance;
  if (!channel->opened) say(fmi2Error, "it has no fmi2Instantiate: not a library of FMI 2.0");
}

/* Whoever holds the other end is gone, however it went */
static void *die_with_parent(void *unused) {
  struct pollfd lifeline = {.fd = LIFELINE_FD, .events = POLLIN};
  for (;;)
    if (poll(&lifeline, 1, -1) > 0) _exit(0);
  return unused;
}

static void follow_cpu(void) {
#if defined __linux__
  static uint32_t at = UINT32_MAX;
  uint32_t cpu = atomic_load(&channel->cpu);
  if (cpu == at || cpu >= CPU_SETSIZE) return;
  at = cpu;
  cpu_set_t only;
  CPU_ZERO(&only);
  CPU_SET(cpu, &only);
  sched_setaffinity(0, sizeof only, &only);
#endif
}

static void limit_memory(const char *bytes) {
  rlim_t most = (rlim_t)strtoull(bytes, NULL, 10);
  struct rlimit memory = {most, most}, none = {0, 0};
  setrlimit(RLIMIT_CORE, &none);
  if (most) setrlimit(RLIMIT_AS, &memory);
}

static int64_t peak_memory(void) {
  struct rusage usage = {0};
  getrusage(RUSAGE_SELF, &usage);
  return rusage_bytes(&usage);
}

int main(int n, char **arguments) {
  if (n != 3) return 2;
  channel = mmap(NULL, sizeof *channel, PROT_READ | PROT_WRITE, MAP_SHARED, CHANNEL_FD, 0);
  if (channel == MAP_FAILED) return 2;
  close(CHANNEL_FD);
  channel->inherited = peak_memory();
  pthread_t watcher;
  pthread_attr_t small;
  pthread_attr_init(&small);
  pthread_attr_setstacksize(&small, 64 * 1024);
  if (pthread_create(&watcher, &small, die_with_parent, NULL)) return 2;
  limit_memory(arguments[2]);
  open_library(arguments[1]);
  for (uint32_t done = 0;; done++) {
    count_up(&channel->answered); /* the first answer: that the library is open */
    while (atomic_load(&channel->asked) == done) wait_while(&channel->asked, done, 3600);
    follow_cpu();
    carry_out();
  }
}
