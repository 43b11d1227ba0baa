/* The simulation's side of one isolated unit: its process, and what has been put together for it and read from it. */
#ifndef COSIM_REMOTE_H
#define COSIM_REMOTE_H

#include <stdbool.h>
#include <sys/types.h>

#include "channel.h"
#include "isolation.h"

enum { MOST_READS = 8 };

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

extern const char *const call_names[]; /* by Call */

/* process.c */
/* Without a process. NULL: no memory. */
Remote *create_remote(const Isolation *wanted, const char *name, const fmi2CallbackFunctions *callbacks);
/* Its process, which opens the library: the first answer. */
bool start_process(Remote *r, const Isolation *wanted);
/* Until `answered` is no longer `before`; false: the process has ended, `ended` says how. */
bool await_answer(Remote *r, uint32_t before);
/* The process, too, where it still runs. */
void discard_remote(Remote *r);

#endif
