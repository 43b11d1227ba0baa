/* The process of an isolated unit: started, waited for, ended, and how it ended in words. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "remote.h"

enum { SLICE_MS = 20, TOLD_INPUTS = 8 };
extern char **environ;

const char *const call_names[] = {
#define NAME(name) "fmi2" #name,
    CALLS(NAME)};

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

static void tell_end(Remote *r, const char *how, int64_t held) {
  Call call = atomic_load(&r->channel->call);
  if (call == CALL_OPEN)
    add(r, "%s", how);
  else
    add(r, "%s at t = %.9g s %s", call >= 0 && call < N_CALLS ? call_names[call] : "a call", r->time, how);
  const char *before = "; last inputs ";
  int told = 0;
  for (size_t k = 0; k < r->n_inputs && told < TOLD_INPUTS; k++) {
    if (!r->inputs[k].set) continue;
    add(r, "%s%s = %.9g", before, r->inputs[k].name, r->inputs[k].value);
    before = ", ";
    told++;
  }
  if (r->memory_limit > 0 && held > r->channel->inherited && (double)held > 0.8 * r->memory_limit)
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
  tell_end(r, how, rusage_bytes(&usage));
  return true;
}

static bool is_interrupted(const Remote *r) {
  struct pollfd file = {.fd = r->pending, .events = POLLIN};
  return r->pending >= 0 && poll(&file, 1, 0) > 0;
}

static bool end(Remote *r, const char *why) {
  kill(r->pid, SIGKILL);
  while (!is_gone(r, why)) continue;
  return false;
}

bool await_answer(Remote *r, uint32_t before) {
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

bool start_process(Remote *r, const Isolation *wanted) {
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

void discard_remote(Remote *r) {
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

Remote *create_remote(const Isolation *wanted, const char *name, const fmi2CallbackFunctions *callbacks) {
  Remote *r = calloc(1, sizeof *r);
  if (!r) return NULL;
  r->lifeline = r->printed = -1;
  r->pending = wanted->pending;
  r->time_limit = wanted->time_limit;
  r->memory_limit = (double)wanted->memory_limit;
  r->callbacks = *callbacks;
  r->name = strdup(name);
  r->inputs = calloc(wanted->n_inputs + 1, sizeof *r->inputs);
  if (!r->name || !r->inputs) return discard_remote(r), NULL;
  for (; r->n_inputs < wanted->n_inputs; r->n_inputs++) {
    size_t k = r->n_inputs;
    r->inputs[k] = (Input){strdup(wanted->input_names[k]), wanted->input_types[k], wanted->input_refs[k], false, 0};
    if (!r->inputs[k].name) return discard_remote(r), NULL;
  }
  return r;
}
