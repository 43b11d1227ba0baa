/* What a simulation (proxy.c) and the process of one isolated unit (host.c) share: a batch of FMI calls, and its answers.
 *
 * The proxy writes commands into `in` and counts `asked` up; the host carries them out in order up to the first that fails, writes
 * answers into `out` and counts `answered` up. Each sleeps on the other's counter. */
#ifndef COSIM_CHANNEL_H
#define COSIM_CHANNEL_H

#include <stdatomic.h>
#include <stdint.h>
#include <sys/resource.h>
#include <time.h>

#if defined __linux__
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

enum { AREA = 1 << 20, SAID = 1024 };
enum { CHANNEL_FD = 3, LIFELINE_FD = 4 }; /* of the host; the lifeline ends when the simulation's process does */

#define CALLS(X)                                                                                                       \
  X(Instantiate)                                                                                                       \
  X(FreeInstance)                                                                                                      \
  X(Reset)                                                                                                             \
  X(SetupExperiment)                                                                                                   \
  X(EnterInitializationMode)                                                                                           \
  X(ExitInitializationMode)                                                                                            \
  X(Terminate)                                                                                                         \
  X(SetReal)                                                                                                           \
  X(SetInteger)                                                                                                        \
  X(SetBoolean)                                                                                                        \
  X(SetString)                                                                                                         \
  X(GetReal)                                                                                                           \
  X(GetInteger)                                                                                                        \
  X(GetBoolean)                                                                                                        \
  X(GetString)                                                                                                         \
  X(SetRealInputDerivatives)                                                                                           \
  X(GetRealOutputDerivatives)                                                                                          \
  X(GetDirectionalDerivative)                                                                                          \
  X(DoStep)                                                                                                            \
  X(GetBooleanStatus)                                                                                                  \
  X(GetFMUstate)                                                                                                       \
  X(SetFMUstate)                                                                                                       \
  X(FreeFMUstate)

#define CALL_ID(name) CALL_##name,
typedef enum { CALLS(CALL_ID) N_CALLS, CALL_OPEN = -1 } Call;

typedef struct { /* followed by its arrays, each padded to 8 bytes */
  int32_t call;
  int32_t ahead;  /* 1: answered in advance; where it fails, nothing else does */
  uint32_t n, m;  /* lengths of arrays, or flags */
  uint32_t size;  /* bytes of this and its arrays */
  uint32_t reply; /* where in `out` its values go, behind an Answer */
  uint32_t state; /* number of a kept FMU state */
  uint32_t unused;
  double real[3];
} Command;

typedef struct {
  int32_t status, done;
} Answer;

typedef struct {
  _Atomic uint32_t asked, answered;
  _Atomic int32_t call; /* under way in the unit */
  _Atomic uint32_t cpu; /* of the simulation: the host follows it, since a hand-over on one core costs least */
  int32_t opened;       /* 1: the library is loaded; 0: `said` tells why it is not */
  int32_t refused;      /* the call that ended the batch; -1: none did */
  int32_t said_status;  /* what the unit logged last in this batch; 0: nothing */
  uint32_t n_in;        /* bytes */
  int64_t inherited;    /* bytes: the peak of the process that started this one, which rusage counts as its own */
  char said[SAID];
  _Alignas(8) char in[AREA];
  _Alignas(8) char out[AREA];
} Channel;

/* Peak memory, which macOS gives in bytes and others in KiB */
static inline int64_t rusage_bytes(const struct rusage *usage) {
#if defined __APPLE__
  return usage->ru_maxrss;
#else
  return (int64_t)usage->ru_maxrss * 1024;
#endif
}

static inline uint32_t padded(size_t size) { return (uint32_t)((size + 7) & ~(size_t)7); }

/* Sleeps while *counter is `value`, for `seconds` at most */
static inline void wait_while(_Atomic uint32_t *counter, uint32_t value, double seconds) {
#if defined __linux__
  struct timespec t = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};
  syscall(SYS_futex, counter, FUTEX_WAIT, value, &t, NULL, 0);
#else
  const struct timespec a_little = {0, 20000};
  (void)seconds;
  if (atomic_load(counter) == value) nanosleep(&a_little, NULL);
#endif
}

static inline void count_up(_Atomic uint32_t *counter) {
  atomic_fetch_add(counter, 1);
#if defined __linux__
  syscall(SYS_futex, counter, FUTEX_WAKE, 1, NULL, NULL, 0);
#endif
}

#endif
