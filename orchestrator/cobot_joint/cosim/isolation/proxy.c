/* FMI 2.0 functions of a unit that lives in a process of its own (host.c).
 *
 * A call travels as a command through shared memory. While time runs, those that set something wait for the next that asks, and what
 * was read after the last step is read ahead with the next: a step is one hand-over and back. A unit that ends (signal, exit, time
 * limit) makes its call and every later one return fmi2Fatal; cosim_ended says how. */
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "remote.h"

enum { MOST_VALUES = 16384 };

static _Thread_local Isolation *next_one;
static _Thread_local char freed[SAID];

void cosim_isolate(Isolation *next) { next_one = next; }
const char *cosim_ended(fmi2Component component) {
  const Remote *r = component;
  const char *words = r ? r->ended : freed;
  return words[0] ? words : NULL;
}

/* Batches ------------------------------------------------------------------------------------------------------------------- */

static void pass_on_said(Remote *r) {
  Channel *channel = r->channel;
  if (!channel->said_status || !r->callbacks.logger) return;
  channel->said[SAID - 1] = '\0';
  r->callbacks.logger(r->callbacks.componentEnvironment, r->name, (fmi2Status)channel->said_status, "unit", "%s",
                      channel->said);
}

static const Answer *answer_to(const Remote *r, uint32_t reply) { return (const Answer *)(r->channel->out + reply); }

/* Sends what has been put together; the status of its last command, or of the one that failed */
static fmi2Status send(Remote *r) {
  if (r->ended[0]) return fmi2Fatal;
  Channel *channel = r->channel;
  if (!r->last) return fmi2OK;
#if defined __linux__
  atomic_store(&channel->cpu, (uint32_t)sched_getcpu());
#endif
  uint32_t before = atomic_load(&channel->answered), reply = r->last->reply;
  int32_t asked = r->last->call;
  for (uint32_t at = 0; at < channel->n_in; at += ((Command *)(channel->in + at))->size)
    ((Answer *)(channel->out + ((Command *)(channel->in + at))->reply))->done = 0;
  count_up(&channel->asked);
  bool answered = await_answer(r, before);
  channel->n_in = 0;
  r->last = NULL;
  if (!answered) return fmi2Fatal;
  pass_on_said(r);
  if (channel->refused >= 0 && channel->refused != asked && channel->refused < N_CALLS && !channel->said_status &&
      r->callbacks.logger)
    r->callbacks.logger(r->callbacks.componentEnvironment, r->name, fmi2Error, "unit", "%s was refused",
                        call_names[channel->refused]);
  if (channel->refused >= 0 && !answer_to(r, reply)->done) return fmi2Error;
  return (fmi2Status)answer_to(r, reply)->status;
}

/* Room for a command with arrays of `bytes` and an answer of `values` bytes; NULL: there is none */
static Command *put(Remote *r, Call call, size_t bytes, size_t values) {
  Channel *channel = r->channel;
  uint32_t size = padded(sizeof(Command) + bytes), answer = padded(sizeof(Answer) + values);
  if (bytes > AREA / 4 || values > AREA / 4) return NULL;
  if ((channel->n_in + size > AREA || r->reply + answer > AREA) && send(r) > fmi2Warning) return NULL;
  if (r->reply + answer > AREA) {
    r->reply = 0;
    for (int k = 0; k < r->n_reads; k++) r->reads[k].answered = false;
  }
  Command *c = (Command *)(channel->in + channel->n_in);
  *c = (Command){.call = call, .size = size, .reply = r->reply};
  channel->n_in += size;
  r->reply += answer;
  r->last = c;
  return c;
}

/* Something changes: what has been read is of the past */
static Command *change(Remote *r, Call call, size_t bytes) {
  for (int k = 0; k < r->n_reads; k++) r->reads[k].answered = false;
  if (r->channel->n_in == 0) r->reply = 0;
  return put(r, call, bytes, 0);
}

/* Waits for the next that asks, while time runs */
static fmi2Status post(Remote *r) { return r->stepping && !r->ended[0] ? fmi2OK : send(r); }

static char *array(Command *c, uint32_t *at, const void *content, size_t size) {
  char *place = (char *)(c + 1) + *at;
  if (size) memcpy(place, content, size);
  memset(place + size, 0, padded(size) - size);
  *at += padded(size);
  return place;
}

/* Reads --------------------------------------------------------------------------------------------------------------------- */

static bool same(const Command *a, const Command *b) {
  return a->call == b->call && a->n == b->n && a->m == b->m && a->size == b->size &&
         memcmp(a + 1, b + 1, a->size - sizeof *a) == 0;
}

static void remember(Remote *r, const Command *c) {
  if (r->n_reads == MOST_READS) return;
  Command *copy = malloc(c->size);
  if (!copy) return;
  memcpy(copy, c, c->size);
  r->reads[r->n_reads++] = (Read){copy, c->reply, true, true};
}

/* The command put last, from what was read already or from the unit */
static fmi2Status read_values(Remote *r, Command *c, void *values, size_t size) {
  Channel *channel = r->channel;
  bool alone = r->stepping && channel->n_in == c->size;
  for (int k = 0; alone && k < r->n_reads; k++) {
    Read *known = &r->reads[k];
    if (!known->answered || !same(known->command, c)) continue;
    channel->n_in = 0;
    r->last = NULL;
    known->used = true;
    memcpy(values, answer_to(r, known->reply) + 1, size);
    return (fmi2Status)answer_to(r, known->reply)->status;
  }
  uint32_t reply = c->reply;
  Command *copy = NULL;
  if (alone && (copy = malloc(c->size))) memcpy(copy, c, c->size);
  fmi2Status status = send(r);
  if (status <= fmi2Warning) {
    memcpy(values, answer_to(r, reply) + 1, size);
    if (copy) remember(r, copy);
  }
  free(copy);
  return status;
}

/* Behind a step: what was read after the last one */
static void read_ahead(Remote *r) {
  int kept = 0;
  for (int k = 0; k < r->n_reads; k++) {
    Read read = r->reads[k];
    const Command *wanted = read.command;
    size_t values = (size_t)wanted->n * sizeof(double);
    Command *last = r->last, *c = NULL;
    bool room = r->channel->n_in + wanted->size <= AREA && r->reply + padded(sizeof(Answer) + values) <= AREA;
    if (!read.used || !room || !(c = put(r, (Call)wanted->call, wanted->size - sizeof *wanted, values))) {
      free(read.command);
      continue;
    }
    r->last = last; /* the step is what was asked for */
    uint32_t reply = c->reply;
    memcpy(c, wanted, wanted->size);
    c->reply = reply;
    c->ahead = 1;
    r->reads[kept++] = (Read){read.command, reply, false, false};
  }
  r->n_reads = kept;
}

/* FMI ----------------------------------------------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

static int32_t instantiate(Remote *r, const Isolation *wanted, const char *guid, const char *resources,
                           uint32_t flags) {
  if (!start_process(r, wanted)) return NO_PROCESS;
  if (!await_answer(r, 0)) return NOT_OPENED;
  if (!r->channel->opened) return pass_on_said(r), NOT_OPENED;
  size_t bytes[] = {strlen(r->name) + 1, strlen(guid) + 1, strlen(resources) + 1};
  Command *c = put(r, CALL_Instantiate, padded(bytes[0]) + padded(bytes[1]) + padded(bytes[2]), 0);
  if (!c) return REFUSED;
  uint32_t at = 0;
  array(c, &at, r->name, bytes[0]), array(c, &at, guid, bytes[1]), array(c, &at, resources, bytes[2]);
  c->n = flags & 1;
  c->m = flags >> 1;
  return send(r) <= fmi2Warning ? RUNS : r->ended[0] ? ENDED : REFUSED;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
  Isolation *wanted = next_one;
  next_one = NULL;
  Remote *r = wanted && type == fmi2CoSimulation ? create_remote(wanted, name, callbacks) : NULL;
  if (!r) return NULL;
  wanted->outcome =
      instantiate(r, wanted, guid, resources ? resources : "", (visible != 0) | (uint32_t)(logging != 0) << 1);
  if (wanted->outcome == RUNS) return r;
  if (r->ended[0] && callbacks->logger)
    callbacks->logger(callbacks->componentEnvironment, name, fmi2Fatal, "unit", "%s", r->ended);
  discard_remote(r);
  return NULL;
}

static fmi2Status simple(Remote *r, Call call) { return change(r, call, 0) ? send(r) : fmi2Fatal; }

void fmi2FreeInstance(fmi2Component c) {
  Remote *r = c;
  if (!r) return;
  freed[0] = '\0';
  if (!r->ended[0] && simple(r, CALL_FreeInstance) > fmi2Warning) snprintf(freed, sizeof freed, "%s", r->ended);
  discard_remote(r);
}

fmi2Status fmi2Reset(fmi2Component c) {
  Remote *r = c;
  r->stepping = false;
  for (size_t k = 0; k < r->n_inputs; k++) r->inputs[k].set = false;
  return simple(r, CALL_Reset);
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return simple(c, CALL_EnterInitializationMode); }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  fmi2Status status = simple(c, CALL_ExitInitializationMode);
  ((Remote *)c)->stepping = status <= fmi2Warning;
  return status;
}
fmi2Status fmi2Terminate(fmi2Component c) {
  ((Remote *)c)->stepping = false;
  return simple(c, CALL_Terminate);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
  Command *command = change(c, CALL_SetupExperiment, 0);
  if (!command) return fmi2Fatal;
  command->n = (has_tolerance != 0) | (uint32_t)(has_stop != 0) << 1;
  command->real[0] = tolerance, command->real[1] = start, command->real[2] = stop;
  ((Remote *)c)->time = start;
  return send(c);
}

static void note_input(Remote *r, char type, fmi2ValueReference ref, double value) {
  for (size_t k = 0; k < r->n_inputs; k++)
    if (r->inputs[k].type == type && r->inputs[k].ref == ref) r->inputs[k].value = value, r->inputs[k].set = true;
}

/* Longer rows go in parts */
#define ACCESS(Type)                                                                                                   \
  fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference refs[], size_t n, const fmi2##Type values[]) {    \
    for (size_t first = 0; first < n; first += MOST_VALUES) {                                                          \
      uint32_t at = 0, m = (uint32_t)(n - first < MOST_VALUES ? n - first : MOST_VALUES);                              \
      Command *command = change(c, CALL_Set##Type, padded(m * sizeof *refs) + padded(m * sizeof *values));             \
      if (!command) return fmi2Fatal;                                                                                  \
      command->n = m;                                                                                                  \
      array(command, &at, refs + first, m * sizeof *refs), array(command, &at, values + first, m * sizeof *values);    \
      for (uint32_t k = 0; k < m; k++) note_input(c, #Type[0], refs[first + k], (double)values[first + k]);            \
      fmi2Status status = post(c);                                                                                     \
      if (status > fmi2Warning) return status;                                                                         \
    }                                                                                                                  \
    return fmi2OK;                                                                                                     \
  }                                                                                                                    \
  fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference refs[], size_t n, fmi2##Type values[]) {          \
    for (size_t first = 0; first < n; first += MOST_VALUES) {                                                          \
      uint32_t at = 0, m = (uint32_t)(n - first < MOST_VALUES ? n - first : MOST_VALUES);                              \
      Command *command = put(c, CALL_Get##Type, m * sizeof *refs, m * sizeof(double));                                 \
      if (!command) return fmi2Fatal;                                                                                  \
      command->n = m;                                                                                                  \
      array(command, &at, refs + first, m * sizeof *refs);                                                             \
      fmi2Status status = read_values(c, command, values + first, m * sizeof *values);                                 \
      if (status > fmi2Warning) return status;                                                                         \
    }                                                                                                                  \
    return fmi2OK;                                                                                                     \
  }
ACCESS(Real)
ACCESS(Integer)
ACCESS(Boolean)

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference refs[], size_t n, const fmi2String values[]) {
  for (size_t k = 0; k < n; k++) {
    size_t size = strlen(values[k]) + 1;
    uint32_t at = 0;
    Command *command = change(c, CALL_SetString, padded(sizeof *refs) + padded(size));
    if (!command) return fmi2Fatal;
    command->n = 1;
    array(command, &at, refs + k, sizeof *refs), array(command, &at, values[k], size);
    fmi2Status status = send(c);
    if (status > fmi2Warning) return status;
  }
  return fmi2OK;
}

/* One at a time: the text is the proxy's until the next call */
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference refs[], size_t n, fmi2String values[]) {
  Remote *r = c;
  if (n != 1) return fmi2Error;
  uint32_t at = 0;
  Command *command = put(r, CALL_GetString, sizeof *refs, SAID);
  if (!command) return fmi2Fatal;
  command->n = 1;
  array(command, &at, refs, sizeof *refs);
  fmi2Status status = read_values(r, command, r->text, SAID);
  r->text[SAID - 1] = '\0';
  values[0] = r->text;
  return status;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference refs[], size_t n,
                                       const fmi2Integer orders[], const fmi2Real values[]) {
  uint32_t at = 0;
  Command *command = change(c, CALL_SetRealInputDerivatives, 2 * padded(n * sizeof *refs) + n * sizeof *values);
  if (!command) return fmi2Fatal;
  command->n = (uint32_t)n;
  array(command, &at, refs, n * sizeof *refs), array(command, &at, orders, n * sizeof *orders);
  array(command, &at, values, n * sizeof *values);
  return post(c);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference refs[], size_t n,
                                        const fmi2Integer orders[], fmi2Real values[]) {
  uint32_t at = 0;
  Command *command = put(c, CALL_GetRealOutputDerivatives, 2 * padded(n * sizeof *refs), n * sizeof *values);
  if (!command) return fmi2Fatal;
  command->n = (uint32_t)n;
  array(command, &at, refs, n * sizeof *refs), array(command, &at, orders, n * sizeof *orders);
  return read_values(c, command, values, n * sizeof *values);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                        const fmi2ValueReference known[], size_t m, const fmi2Real seed[],
                                        fmi2Real values[]) {
  uint32_t at = 0;
  size_t bytes = padded(n * sizeof *unknown) + padded(m * sizeof *known) + m * sizeof *seed;
  Command *command = put(c, CALL_GetDirectionalDerivative, bytes, n * sizeof *values);
  if (!command) return fmi2Fatal;
  command->n = (uint32_t)n;
  command->m = (uint32_t)m;
  array(command, &at, unknown, n * sizeof *unknown), array(command, &at, known, m * sizeof *known);
  array(command, &at, seed, m * sizeof *seed);
  return read_values(c, command, values, n * sizeof *values);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean keeps_no_state) {
  Remote *r = c;
  Command *command = change(r, CALL_DoStep, 0);
  if (!command) return fmi2Fatal;
  command->n = keeps_no_state != 0;
  command->real[0] = t, command->real[1] = h;
  r->time = t;
  if (r->stepping) read_ahead(r);
  fmi2Status status = send(r);
  for (int k = 0; k < r->n_reads; k++) {
    const Answer *answer = answer_to(r, r->reads[k].reply);
    r->reads[k].answered = status <= fmi2Warning && answer->done && answer->status <= fmi2Warning;
  }
  return status;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  Command *command = put(c, CALL_GetBooleanStatus, 0, sizeof(double));
  if (!command) return fmi2Fatal;
  command->n = (uint32_t)kind;
  return read_values(c, command, value, sizeof *value);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  Remote *r = c;
  bool known = *state != NULL;
  Command *command = change(r, CALL_GetFMUstate, 0);
  if (!command) return fmi2Fatal;
  if (!known) *state = (fmi2FMUstate)(uintptr_t)++r->n_states;
  command->state = (uint32_t)(uintptr_t)*state;
  return known ? post(r) : send(r);
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  Command *command = change(c, CALL_SetFMUstate, 0);
  if (!command) return fmi2Fatal;
  command->state = (uint32_t)(uintptr_t)state;
  return post(c);
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  Remote *r = c;
  if (!*state || r->ended[0]) return fmi2OK;
  Command *command = change(r, CALL_FreeFMUstate, 0);
  if (!command) return fmi2Fatal;
  command->state = (uint32_t)(uintptr_t)*state;
  *state = NULL;
  return send(r);
}

/* FMPy loads a library only if it has them all; the master calls none of these. */
#define WITHOUT(name, ...)                                                                                             \
  fmi2Status name(__VA_ARGS__) { return fmi2Error; }
#pragma GCC diagnostic ignored "-Wunused-parameter"
WITHOUT(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
WITHOUT(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state, size_t *size)
WITHOUT(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
WITHOUT(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
WITHOUT(fmi2CancelStep, fmi2Component c)
WITHOUT(fmi2GetStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
WITHOUT(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
WITHOUT(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
WITHOUT(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
