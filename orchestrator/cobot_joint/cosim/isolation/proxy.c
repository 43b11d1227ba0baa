/* FMI 2.0 functions of a unit that lives in a process of its own (host.c).
 *
 * A call travels as a command through shared memory. While time runs, those that set something wait for the next that asks, and what
 * was read after the last step is read ahead with the next: a step is one hand-over and back. A unit that ends (signal, exit, time
 * limit) makes its call and every later one return fmi2Fatal; cosim_ended says how. */
#include "isolation.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "channel.h"
#include "fmi2Functions.h"

enum { MOST_READS = 8, MOST_VALUES = 16384, SLICE_MS = 20, TOLD_INPUTS = 8 };
extern char **environ;

typedef struct { /* values asked for since the last change: what is asked again is not sent again */
  Command *command;
  uint32_t reply;
  bool answered, used;
} Read;

typedef struct {
  char *name, type;
  uint32_t ref;
  bool set;
  double value;
} Input;

typedef struct {
  Channel *channel;
  pid_t pid;
  int lifeline, printed, pending;
  double time_limit, memory_limit;
  bool stepping;
  double time;
  uint32_t reply; /* next free byte of `out` */
  Command *last;  /* of the batch */
  Read reads[MOST_READS];
  int n_reads;
  uint32_t n_states;
  size_t n_inputs;
  Input *inputs;
  fmi2CallbackFunctions callbacks;
  char *name;
  char text[SAID];
  char ended[SAID];
} Remote;

static _Thread_local Isolation *next_one;
static _Thread_local char freed[SAID];

static const char *const names[] = {
#define NAME(name) "fmi2" #name,
    CALLS(NAME)};

void cosim_isolate(Isolation *next) { next_one = next; }
const char *cosim_ended(fmi2Component component) {
  const Remote *r = component;
  const char *words = r ? r->ended : freed;
  return words[0] ? words : NULL;
}

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* How a process ended ------------------------------------------------------------------------------------------------------- */

static void add(Remote *r, const char *format, ...) {
  size_t n = strlen(r->ended);
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(r->ended + n, sizeof r->ended - n, format, arguments);
  va_end(arguments);
}

static const char *signal_name(int number) {
  switch (number) {
    case SIGSEGV: return "SIGSEGV: memory that is not its own, or no stack left";
    case SIGFPE: return "SIGFPE: an integer divided by zero";
    case SIGABRT: return "SIGABRT: abort() or a failed assertion";
    case SIGBUS: return "SIGBUS: memory or a file that ends too early";
    case SIGILL: return "SIGILL: not an instruction of this machine";
    case SIGKILL: return "SIGKILL: somebody, or the system for want of memory, ended it";
    default: return strsignal(number);
  }
}

/* The last line that the unit printed */
static void add_printed(Remote *r) {
  static _Thread_local char all[65537];
  ssize_t n = read(r->printed, all, sizeof all - 1);
  if (n <= 0) return;
  while (n > 0 && (unsigned char)all[n - 1] <= ' ') n--;
  all[n] = '\0';
  char *line = strrchr(all, '\n');
  line = line ? line + 1 : all;
  for (char *c = line; *c; c++)
    if ((unsigned char)*c < ' ') *c = ' ';
  if (*line) add(r, "; it printed: %.200s", line);
}

static void tell_end(Remote *r, const char *how, long held) {
  Call call = atomic_load(&r->channel->call);
  if (call == CALL_OPEN)
    add(r, "%s", how);
  else
    add(r, "%s at t = %.9g s %s", call >= 0 && call < N_CALLS ? names[call] : "a call", r->time, how);
  const char *before = "; last inputs ";
  int told = 0;
  for (size_t k = 0; k < r->n_inputs && told < TOLD_INPUTS; k++) {
    if (!r->inputs[k].set) continue;
    add(r, "%s%s = %.9g", before, r->inputs[k].name, r->inputs[k].value);
    before = ", ";
    told++;
  }
  if (r->memory_limit > 0 && (double)held > 0.8 * r->memory_limit)
    add(r, "; it held %.0f MB, %.0f MB are allowed (--memory-limit)", (double)held * 1e-6, r->memory_limit * 1e-6);
  add_printed(r);
}

/* Has the process ended? Then `ended` says how. `why`: for what it has been killed; NULL: for nothing. */
static bool is_gone(Remote *r, const char *why) {
  int status = 0;
  struct rusage usage = {0};
  pid_t found = wait4(r->pid, &status, why ? 0 : WNOHANG, &usage);
  if (found == 0 || (found < 0 && errno == EINTR)) return false;
  char how[160];
  if (why)
    snprintf(how, sizeof how, "%s", why);
  else if (found > 0 && WIFSIGNALED(status))
    snprintf(how, sizeof how, "crashed (%s)", signal_name(WTERMSIG(status)));
  else if (found > 0)
    snprintf(how, sizeof how, "ended its process: exit(%d)", WEXITSTATUS(status));
  else
    snprintf(how, sizeof how, "ended its process");
  r->pid = 0;
#if defined __APPLE__
  tell_end(r, how, usage.ru_maxrss);
#else
  tell_end(r, how, usage.ru_maxrss * 1024L);
#endif
  return true;
}

/* Batches ------------------------------------------------------------------------------------------------------------------- */

static bool is_interrupted(const Remote *r) {
  struct pollfd file = {.fd = r->pending, .events = POLLIN};
  return r->pending >= 0 && poll(&file, 1, 0) > 0;
}

static bool end(Remote *r, const char *why) {
  kill(r->pid, SIGKILL);
  while (!is_gone(r, why)) continue;
  return false;
}

static bool await(Remote *r, uint32_t before) {
  Channel *channel = r->channel;
  double begun = now();
  while (atomic_load(&channel->answered) == before) {
    wait_while(&channel->answered, before, SLICE_MS * 1e-3);
    if (atomic_load(&channel->answered) != before) break;
    if (is_gone(r, NULL)) return false;
    char late[80];
    snprintf(late, sizeof late, "did not return within %g s (--time-limit)", r->time_limit);
    if (is_interrupted(r)) return end(r, "was interrupted");
    if (now() - begun > r->time_limit) return end(r, late);
  }
  return true;
}

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
  bool answered = await(r, before);
  channel->n_in = 0;
  r->last = NULL;
  if (!answered) return fmi2Fatal;
  pass_on_said(r);
  if (channel->refused >= 0 && channel->refused != asked && channel->refused < N_CALLS && !channel->said_status &&
      r->callbacks.logger)
    r->callbacks.logger(r->callbacks.componentEnvironment, r->name, fmi2Error, "unit", "%s was refused",
                        names[channel->refused]);
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

/* Processes ----------------------------------------------------------------------------------------------------------------- */

static int shared_file(void) {
#if defined __linux__
  return memfd_create("cosim channel", MFD_CLOEXEC);
#else
  char name[64];
  static atomic_int count;
  snprintf(name, sizeof name, "/cosim.%ld.%d", (long)getpid(), atomic_fetch_add(&count, 1));
  int file = shm_open(name, O_RDWR | O_CREAT | O_EXCL, 0600);
  if (file >= 0) shm_unlink(name), fcntl(file, F_SETFD, FD_CLOEXEC);
  return file;
#endif
}

static bool closed_pipe(int ends[2]) {
  if (pipe(ends)) return false;
  for (int k = 0; k < 2; k++) fcntl(ends[k], F_SETFD, FD_CLOEXEC);
  return true;
}

/* With `file` as its channel. Files of the parent are high up first, lest one take another's number. */
static bool spawn(Remote *r, const Isolation *wanted, int file, int lifeline, int prints) {
  char memory[32];
  snprintf(memory, sizeof memory, "%llu", (unsigned long long)wanted->memory_limit);
  char *arguments[] = {(char *)wanted->host, (char *)wanted->library, memory, NULL};
  int channel = fcntl(file, F_DUPFD_CLOEXEC, 10), life = fcntl(lifeline, F_DUPFD_CLOEXEC, 10);
  int out = fcntl(prints, F_DUPFD_CLOEXEC, 10);
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, out, 1);
  posix_spawn_file_actions_adddup2(&actions, out, 2);
  posix_spawn_file_actions_adddup2(&actions, channel, CHANNEL_FD);
  posix_spawn_file_actions_adddup2(&actions, life, LIFELINE_FD);
  posix_spawnattr_init(&attributes); /* a group of its own: Ctrl-C is the simulation's business */
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  int failed = channel < 0 || life < 0 || out < 0 ||
               posix_spawn(&r->pid, wanted->host, &actions, &attributes, arguments, environ);
  if (failed) r->pid = 0;
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  if (channel >= 0) close(channel);
  if (life >= 0) close(life);
  if (out >= 0) close(out);
  return !failed;
}

static bool start(Remote *r, const Isolation *wanted) {
  int file = shared_file(), life[2] = {-1, -1}, prints[2] = {-1, -1};
  bool started = file >= 0 && ftruncate(file, sizeof(Channel)) == 0 && closed_pipe(life) && closed_pipe(prints);
  if (started) {
    r->channel = mmap(NULL, sizeof(Channel), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (r->channel == MAP_FAILED) r->channel = NULL;
    if (r->channel) atomic_store(&r->channel->call, CALL_OPEN);
    for (int k = 0; k < 2; k++) fcntl(prints[k], F_SETFL, O_NONBLOCK); /* who prints much loses it, and goes on */
    started = r->channel && spawn(r, wanted, file, life[0], prints[1]);
  }
  r->lifeline = life[1];
  r->printed = prints[0];
  if (life[0] >= 0) close(life[0]);
  if (prints[1] >= 0) close(prints[1]);
  if (file >= 0) close(file);
  return started;
}

static void discard(Remote *r) {
  if (r->lifeline >= 0) close(r->lifeline);
  if (r->pid > 0) {
    kill(r->pid, SIGKILL);
    while (waitpid(r->pid, NULL, 0) < 0 && errno == EINTR) continue;
  }
  if (r->printed >= 0) close(r->printed);
  if (r->channel) munmap(r->channel, sizeof(Channel));
  for (int k = 0; k < r->n_reads; k++) free(r->reads[k].command);
  for (size_t k = 0; r->inputs && k < r->n_inputs; k++) free(r->inputs[k].name);
  free(r->inputs);
  free(r->name);
  free(r);
}

static Remote *create(const Isolation *wanted, const char *name, const fmi2CallbackFunctions *callbacks) {
  Remote *r = calloc(1, sizeof *r);
  if (!r) return NULL;
  r->lifeline = r->printed = -1;
  r->pending = wanted->pending;
  r->time_limit = wanted->time_limit;
  r->memory_limit = (double)wanted->memory_limit;
  r->callbacks = *callbacks;
  r->name = strdup(name);
  r->inputs = calloc(wanted->n_inputs + 1, sizeof *r->inputs);
  if (!r->name || !r->inputs) return discard(r), NULL;
  for (; r->n_inputs < wanted->n_inputs; r->n_inputs++) {
    size_t k = r->n_inputs;
    r->inputs[k] = (Input){strdup(wanted->input_names[k]), wanted->input_types[k], wanted->input_refs[k], false, 0};
    if (!r->inputs[k].name) return discard(r), NULL;
  }
  return r;
}

/* FMI ----------------------------------------------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

static int32_t instantiate(Remote *r, const Isolation *wanted, const char *guid, const char *resources,
                           uint32_t flags) {
  if (!start(r, wanted)) return NO_PROCESS;
  if (!await(r, 0)) return NOT_OPENED;
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
  Remote *r = wanted && type == fmi2CoSimulation ? create(wanted, name, callbacks) : NULL;
  if (!r) return NULL;
  wanted->outcome =
      instantiate(r, wanted, guid, resources ? resources : "", (visible != 0) | (uint32_t)(logging != 0) << 1);
  if (wanted->outcome == RUNS) return r;
  if (r->ended[0] && callbacks->logger)
    callbacks->logger(callbacks->componentEnvironment, name, fmi2Fatal, "unit", "%s", r->ended);
  discard(r);
  return NULL;
}

static fmi2Status simple(Remote *r, Call call) { return change(r, call, 0) ? send(r) : fmi2Fatal; }

void fmi2FreeInstance(fmi2Component c) {
  Remote *r = c;
  if (!r) return;
  freed[0] = '\0';
  if (!r->ended[0] && simple(r, CALL_FreeInstance) > fmi2Warning) snprintf(freed, sizeof freed, "%s", r->ended);
  discard(r);
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
WITHOUT(fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
WITHOUT(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
